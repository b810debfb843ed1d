"""Times, velocities and swept volumes: levels survive as the session does, and a uniform flow stays uniform."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from mesh_motion_numerics.mesh.local_facets import LOCAL_FACETS
from mesh_motion_numerics.mesh.roles import Patch
from mesh_motion_protocol.messages import Commit, Move, Rollback
from real_sessions import boxed, bulge
from tiny_meshes import tiny_mesh

from mesh_motion_server.service.dispatch import SessionHost
from mesh_motion_server.session.model import build_motion_model
from mesh_motion_server.session.partitions.meshes import PartitionMesh
from mesh_motion_server.settings import ServerSettings
from tests.faults.driver import SESSION, TOKEN, Driver, SessionSpec
from tests.faults.stand_in import split_mesh

LIMITS = ServerSettings(reserve_disk_bytes=0)
#: Uneven steps from 0.5 s on.
TIMES = (0.5, 0.75, 0.8, 1.1, 1.15)


def session(
    store: Any, meshes: list[PartitionMesh], name: str = SESSION, time: float = TIMES[0], **options: Any
) -> Driver:
    d = meshes[0].points.shape[1]
    spec = SessionSpec(session=name, token=TOKEN, dimension=d, partitions=len(meshes), time=time, **options)
    driver = Driver(SessionHost.create(spec, store, limits=LIMITS, build_model=build_motion_model), meshes)
    driver.open()
    return driver


def resumed(driver: Driver, store: Any) -> Driver:
    driver.host._session._built.keeper.close()  # type: ignore[union-attr]
    driver.host._session._folder.release()
    again = Driver(SessionHost.resume(driver.host.session, TOKEN, store, limits=LIMITS), driver.meshes)
    again.sequences = driver.sequences
    return again


def size(time: float) -> float:
    return 0.2 * float(np.sin(2.0 * (time - TIMES[0])))


def step(driver: Driver, number: int, *, commit: bool = True, **fields: Any) -> list[Any]:
    moved = driver.all(
        Move, bulge(driver, size(TIMES[number])), step=number, frame="reference", time=TIMES[number], **fields
    )
    assert {reply.type for reply in moved} == {"MOVED"}, moved
    if commit:
        assert {reply.type for reply in driver.all(Commit, step=number)} == {"COMMITTED"}
    return moved


def run(driver: Driver, scheme: str, steps: int = 4) -> list[np.ndarray]:
    return [step(driver, number, velocity=scheme)[0].velocity for number in range(1, steps + 1)]


@pytest.mark.parametrize("scheme", ["bdf1", "bdf2", "bossak"])
@pytest.mark.parametrize("level", ["full", "replay", "relaxed"])
def test_levels_are_there_after_a_kill_and_after_a_rollback(store: Any, scheme: str, level: str) -> None:
    """Equal bit for bit: velocities of every later step, and digests, which include the levels."""
    kept = "" if scheme == "bdf1" else scheme
    undisturbed = session(store, [boxed(6)], "1" * 32, time_levels=kept, durability=level)
    expected = run(undisturbed, scheme)
    undisturbed.host.close()
    for killed_after in (1, 2, 3):
        driver = session(store, [boxed(6)], str(2 + killed_after) * 32, time_levels=kept, durability=level)
        found = run(driver, scheme, killed_after)
        step(driver, killed_after + 1, commit=False)
        driver.host._session.catch_up()
        driver = resumed(driver, store)
        assert driver.join().time == TIMES[killed_after]
        driver.all(Rollback, step=killed_after + 1)
        for number in range(killed_after + 1, len(TIMES)):
            step(driver, number, commit=False, velocity=scheme)
            driver.all(Rollback, step=number)
            found.append(step(driver, number, velocity=scheme)[0].velocity)
        assert [one.tobytes() for one in found] == [one.tobytes() for one in expected]
        driver.host.close()


def test_partitions_get_what_one_gets(store: Any) -> None:
    one, many = session(store, [boxed(9)], time_levels="bdf2"), split_mesh(boxed(9), 3)
    three = session(store, many, "3" * 32, time_levels="bdf2")
    for number in (1, 2):
        (whole,) = step(one, number, velocity="bdf2", report="swept")
        parts = step(three, number, velocity="bdf2", report="swept")
        for part, mesh in zip(parts, many, strict=True):
            assert (part.velocity == whole.velocity[mesh.global_ids]).all()
        assert sum(len(part.swept) for part in parts) == len(whole.swept)
        np.testing.assert_allclose(sum(part.swept.sum() for part in parts), whole.swept.sum(), atol=1e-15)
        assert sorted(np.concatenate([part.swept for part in parts])) == sorted(whole.swept)
    refused = [
        reply
        for partition, scheme in enumerate(("bdf2", "bdf2", "bdf1"))
        for reply in three.send(
            three.request(Move, partition, step=3, time=2.0, velocity=scheme, displacement=bulge(three, 0.0)[partition])
        )
    ]
    assert {reply.code for reply in refused} == {"INVALID_ARGUMENT.PARTITION"}
    assert "velocity bdf1" in refused[0].message
    one.host.close()
    three.host.close()


@pytest.mark.parametrize(
    ("fields", "code", "named"),
    [
        ({"velocity": "bdf2", "time": 0.6}, "FAILED_PRECONDITION", "open it with time_levels = 'bdf2'"),
        ({"time": 0.5 + 1e31}, "INVALID_ARGUMENT.VALUE", "of step 0, by 1e-30 to 1e+30, got 1e+31"),
        ({"velocity": "tangent"}, "INVALID_ARGUMENT.VALUE", "takes the velocities of the moving nodes"),
        ({"boundary_velocity": np.zeros((6, 2))}, "INVALID_ARGUMENT.VALUE", "takes no boundary_velocity"),
        (
            {"velocity": "tangent", "boundary_velocity": np.full((6, 2), np.inf)},
            "INVALID_ARGUMENT.NONFINITE",
            "boundary_velocity of partition 0, row 0 (node ",
        ),
        (
            {"velocity": "tangent", "boundary_velocity": np.full((6, 2), -1e300)},
            "INVALID_ARGUMENT.VALUE",
            "component 0 is -1e+300, expected at most 1e+75",
        ),
        ({"swept_faces": np.array([[0, 1]])}, "INVALID_ARGUMENT.VALUE", "expected report 'swept', got ''"),
        (
            {"report": "swept", "swept_faces": np.array([[0, 1], [0, 36]])},
            "INVALID_ARGUMENT.VALUE",
            "row 1: column 1 is 36, expected a node 0 … 35",
        ),
        (
            {"report": "swept", "swept_faces": np.array([[0, 1, 2]])},
            "INVALID_ARGUMENT.SHAPE",
            "the two nodes of an edge",
        ),
    ],
)
def test_missing_and_wrong_fields_are_named(store: Any, fields: dict[str, Any], code: str, named: str) -> None:
    driver = session(store, [boxed(6)])
    (refused,) = driver.all(Move, bulge(driver, 0.01), step=1, **fields)
    assert refused.code == code, refused
    assert named in f"{refused.message}; {refused.hint}"
    driver.host.close()


def test_a_step_too_short_for_its_accelerations_is_not_stored(store: Any) -> None:
    """The levels of all later steps would be no numbers."""
    driver = session(store, [boxed(6)], time=0.0, time_levels="bossak")
    driver.all(Move, bulge(driver, 0.01), step=1)
    (refused,) = driver.all(Commit, step=1, time=1e-200)
    assert (refused.code, refused.details["field"]) == ("INVALID_ARGUMENT.VALUE", "time")
    driver.all(Commit, step=1, time=1e-30)
    (moved,) = driver.all(Move, bulge(driver, 0.02), step=2, time=1e-3, velocity="bossak")
    assert np.isfinite(moved.velocity).all()
    driver.host.close()


# --- swept volumes ----------------------------------------------------------------------------------------------------


def cubic() -> PartitionMesh:
    """Tetrahedra in the unit cube, whose lower side moves."""
    points, (block,) = tiny_mesh("tetra", 4)
    low = np.flatnonzero(points[:, 2] == 0)
    walls = np.setdiff1d(np.flatnonzero(((points == 0) | (points == 1)).any(axis=1)), low)
    patches = {"left": Patch("moving", low), "walls": Patch("fixed", walls)}
    return PartitionMesh(points, np.arange(len(points)), {"tetra": block.nodes}, patches)


def triangular() -> PartitionMesh:
    """Triangles in the unit square; every other one is listed clockwise."""
    mesh = boxed(8)
    triangles = np.array(mesh.cells["triangle"])
    triangles[::2] = triangles[::2, ::-1]
    return replace(mesh, cells={"triangle": triangles})


def lower(driver: Driver, by: float) -> list[np.ndarray]:
    (mesh,), (moving,) = driver.meshes, driver.moving
    x = np.delete(mesh.points[moving], {2: 0, 3: 2}[mesh.points.shape[1]], axis=1)
    bump = np.sin(np.pi * x).prod(axis=1)[:, None]
    return [by * bump * np.array([1.0, 0.5, 0.7])[: mesh.points.shape[1]]]


@pytest.mark.parametrize("mesh", [triangular(), cubic()], ids=["triangles", "tetrahedra"])
def test_a_uniform_flow_stays_uniform(store: Any, mesh: PartitionMesh) -> None:
    """ALE advection with finite volumes, upwind and explicit: V u = V₀ u₀ - Σ (U · S Δt - swept) u_up.

    The flux of a uniform flow through a closed cell is zero, so u = 1 is kept only if the swept volumes sum to the
    change of the cell's volume. With velocities times areas of the new mesh, a usual alternative, it is not kept.
    """
    driver = session(store, [mesh])
    ((kind, cells),) = mesh.cells.items()
    d, (rest,) = mesh.points.shape[1], [mesh.points]
    flow = np.array([0.7, -0.4, 0.2])[:d]
    before, u, naive = rest, np.ones(len(cells)), np.ones(len(cells))
    for number in range(1, 4):
        moved = driver.all(Move, lower(driver, 0.1 * number), step=number, frame="reference", report="swept",
                           time=TIMES[number], velocity="bdf1")[0]  # fmt: skip
        dt = TIMES[number] - TIMES[number - 1]
        after = rest + moved.displacement
        volumes = [simplex_volumes(x[cells]) for x in (before, after)]
        faces = np.array(LOCAL_FACETS[kind])
        areas = np.sign(volumes[1])[:, None, None] * area_vectors(after[cells[:, faces]])
        swept = moved.swept.reshape(len(cells), len(faces))
        rough = np.einsum("mfd,mfd->mf", moved.velocity[cells[:, faces]].mean(axis=2), areas) * dt
        np.testing.assert_allclose(swept.sum(axis=1), np.abs(volumes[1]) - np.abs(volumes[0]), rtol=0, atol=1e-15)
        fluxes = np.einsum("d,mfd->mf", flow, areas) * dt
        u = (np.abs(volumes[0]) * u - (fluxes - swept).sum(axis=1)) / np.abs(volumes[1])
        naive = (np.abs(volumes[0]) * naive - (fluxes - rough).sum(axis=1)) / np.abs(volumes[1])
        driver.all(Commit, step=number)
        before = after
    assert np.abs(u - 1.0).max() < 1e-13
    assert np.abs(naive - 1.0).max() > 1e-4
    driver.host.close()


def simplex_volumes(x: np.ndarray) -> np.ndarray:
    d = x.shape[2]
    return np.linalg.det(x[:, 1:] - x[:, :1]) / (2.0 if d == 2 else 6.0)


def area_vectors(x: np.ndarray) -> np.ndarray:
    """(m, f, d) area vectors of faces (m, f, d, d)."""
    if x.shape[-1] == 2:
        edge = x[:, :, 1] - x[:, :, 0]
        return np.stack([edge[..., 1], -edge[..., 0]], axis=-1)
    return 0.5 * np.cross(x[:, :, 1] - x[:, :, 0], x[:, :, 2] - x[:, :, 0])


def test_the_client_that_has_the_nodes_takes_differences_itself(store: Any) -> None:
    from mesh_motion_protocol.errors import InvalidInput  # noqa: PLC0415

    with pytest.raises(InvalidInput, match="expected time_levels '', got 'bdf2'"):
        session(store, [boxed(6)], time_levels="bdf2", evaluation="client")
