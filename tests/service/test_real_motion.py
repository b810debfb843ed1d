"""The real numerics under the requests: quality, refusal, partitions and a resume, bitwise."""

import time
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from mesh_motion_numerics import stopwatch
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.finite_volume import face_measures
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.motion import MotionModel
from mesh_motion_protocol.messages import Commit, Move, Status
from real_sessions import boxed, bulge, new_session

from mesh_motion_server.operation.tally import TALLY
from mesh_motion_server.service.dispatch import SessionHost
from mesh_motion_server.session.history.events import read_events
from tests.faults.driver import SESSION, TOKEN
from tests.faults.stand_in import grid_mesh, split_mesh


def driver_of(store: Any, meshes: list[Any], session: str = SESSION, **settings: Any) -> Any:
    return new_session(store, meshes, session, **{"support_radius": 0.8} | settings)


@pytest.mark.parametrize(("correction", "mirrored"), [("none", 0), ("optimised", 0), ("optimised", 7)])
def test_any_number_of_partitions_and_any_interruption_give_the_same_bits(
    store: Any, correction: str, mirrored: int
) -> None:
    """Also if every n-th cell is listed clockwise."""
    whole = boxed(12)
    if mirrored:
        whole.cells["triangle"][::mirrored] = whole.cells["triangle"][::mirrored, ::-1]
    settings = {"correction": correction, "quality_threshold": 0.3 if correction == "none" else 0.45}
    one = driver_of(store, [whole], **settings)
    many = driver_of(store, split_mesh(whole, 3), "3" * 32, **settings)
    for driver in (one, many):
        warnings = driver.open()[0].mesh["warnings"]
        assert any("listed clockwise" in line for line in warnings) == bool(mirrored)
    for step in (1, 2):
        moved, parts = one.all(Move, bulge(one, 0.15), step=step), many.all(Move, bulge(many, 0.15), step=step)
        assert moved[0].type == "MOVED", moved[0]
        for part, mesh in zip(parts, many.meshes, strict=True):
            assert part.displacement.tobytes() == moved[0].displacement[mesh.global_ids].tobytes()
        assert moved[0].displacement[one.moving[0]].tobytes() == bulge(one, 0.15)[0].tobytes()
        (committed,) = one.all(Commit, step=step)
        assert {reply.digest for reply in many.all(Commit, step=step)} == {committed.digest}
        one.host.close()
        host = SessionHost.resume(SESSION, TOKEN, store)
        one.host = host
        one.join()
    assert all((moved[0].correction[name] > 0) == (correction != "none") for name in ("freed_nodes", "iterations"))
    assert moved[0].quality["metric"] == "relative-size-skew"
    many.host.close()
    one.host.close()


def test_an_impossible_motion_is_refused_with_the_best_found(store: Any) -> None:
    driver = driver_of(store, [boxed(12)])
    driver.open()
    (refused,) = driver.all(Move, bulge(driver, 1.5), step=1)
    assert refused.code == "FAILED_PRECONDITION.QUALITY"
    assert 0 < refused.details["fraction"] < 1
    assert refused.details["best"] < 0.2
    assert {"partition", "type", "cell"} == set(refused.details["worst"][0])
    (moved,) = driver.all(Move, bulge(driver, 1.5 * refused.details["fraction"]), step=1)
    assert moved.type == "MOVED"
    assert moved.quality["corrected"]["inverted"] == 0
    driver.host.close()


def test_warnings_use_the_senders_numbers(store: Any) -> None:
    mesh = grid_mesh(12)
    driver = driver_of(store, [mesh])
    (built,) = driver.open()
    floating = np.setdiff1d(
        np.flatnonzero(((mesh.points == 0) | (mesh.points == 1)).any(axis=1)),
        np.union1d(mesh.patches["left"].nodes, mesh.patches["right"].nodes),
    )
    (warning,) = built.mesh["warnings"]
    assert f"{len(floating)} boundary nodes are in no patch, the first is node {floating[0]};" in warning
    driver.host.close()


def test_faces_are_those_of_the_reference_mesh_and_of_the_answer(store: Any) -> None:
    mesh = boxed(12)
    cells = CellTable.from_arrays(mesh.cells)
    driver = driver_of(store, [mesh])
    driver.open()
    (silent,) = driver.all(Move, bulge(driver, 0.15), step=1)
    assert silent.faces == {}
    (asked,) = driver.all(Move, bulge(driver, 0.15), step=1, report="faces")
    assert asked.displacement.tobytes() == silent.displacement.tobytes()
    for name, points in (("before", mesh.points), ("after", mesh.points + asked.displacement)):
        expected, reported = face_measures(points, cells, mesh.points), asked.faces[name]
        assert {key: reported[key] for key in expected.numbers()} == pytest.approx(expected.numbers(), rel=1e-9)
        for face in reported["worst"]:
            here, there = (set(mesh.cells["triangle"][cell["cell"]]) for cell in (face, face["neighbour"]))
            assert face["centre"] == pytest.approx(points[sorted(here & there)].mean(axis=0).tolist())
    assert asked.faces["after"]["max_non_orthogonality"] > asked.faces["before"]["max_non_orthogonality"]
    (reported,) = [event for event in read_events(store.root / "sessions" / SESSION) if event.get("faces")]
    assert reported["faces"]["after"] == {key: value for key, value in asked.faces["after"].items() if key != "worst"}
    driver.host.close()


def test_of_several_partitions_those_that_ask_get_all_faces(store: Any) -> None:
    whole = boxed(12)
    driver = driver_of(store, split_mesh(whole, 3))
    driver.open()
    reports, replies = ["", "faces", "faces"], []
    for partition, (rows, report) in enumerate(zip(bulge(driver, 0.15), reports, strict=True)):
        replies += driver.send(driver.request(Move, partition, step=1, displacement=rows, report=report))
    assert [bool(reply.faces) for reply in replies] == [False, True, True]
    expected = face_measures(whole.points, CellTable.from_arrays(whole.cells))
    reported = replies[1].faces
    assert reported == replies[2].faces
    assert reported["before"]["faces"] == expected.faces
    assert reported["before"]["max_non_orthogonality"] == pytest.approx(expected.max_non_orthogonality, rel=1e-9)
    assert {face["partition"] for name in ("before", "after") for face in reported[name]["worst"]} <= {0, 1, 2}
    driver.host.close()


def test_the_headroom_is_that_of_the_coordinates_that_were_answered(store: Any) -> None:
    whole, cells = boxed(12), CellTable.from_arrays(boxed(12).cells)
    driver = driver_of(store, split_mesh(whole, 3))
    driver.open()
    points, before = whole.points.copy(), TALLY.spreads.get("move_headroom_steps", [0.0])[-1]
    for step in (1, 2):
        step_rows, replies = np.zeros_like(points), []
        for partition, (rows, report) in enumerate(zip(bulge(driver, 0.1), ("", "faces", "headroom"), strict=True)):
            replies += driver.send(driver.request(Move, partition, step=step, displacement=rows, report=report))
        for reply, mesh in zip(replies, driver.meshes, strict=True):
            step_rows[mesh.global_ids] = reply.displacement
        points += step_rows
        driver.all(Commit, step=step)
    assert not replies[0].headroom
    assert replies[1].headroom == replies[2].headroom
    found, every = replies[1].headroom, np.arange(len(cells))
    model = MotionModel.build(whole.points, cells, whole.patches, Method())
    expected = model.headroom(points - step_rows, points, every)
    assert found["inversion"] == pytest.approx(expected.inversion, rel=1e-9)
    assert found["threshold"] == pytest.approx(expected.threshold, rel=1e-9)
    mesh = driver.meshes[found["cell"]["partition"]]
    nodes = mesh.global_ids[mesh.cells[found["cell"]["type"]][found["cell"]["cell"]]]
    assert set(nodes) == set(whole.cells["triangle"][expected.cell])
    events = [event for event in read_events(store.root / "sessions" / SESSION) if event.get("headroom")]
    assert events[-1]["headroom"] == found
    assert events[-1]["faces"]["after"] == {
        name: replies[1].faces["after"][name] for name in events[-1]["faces"]["after"]
    }
    assert TALLY.spreads["move_headroom_steps"][-1] - before > 0.0
    driver.host.close()


def test_the_headroom_along_the_displacement_and_along_a_velocity(store: Any) -> None:
    whole, cells = boxed(12), CellTable.from_arrays(boxed(12).cells)
    driver = driver_of(store, split_mesh(whole, 3))
    driver.open()
    rows, first, replies = bulge(driver, 0.1), [], []
    for partition in range(3):
        first += driver.send(driver.request(Move, partition, step=1, displacement=rows[partition]))
    driver.all(Commit, step=1)
    ways = ("displacement", "velocity", "step")
    for partition, way in enumerate(ways):
        asked = {"velocity": "tangent", "boundary_velocity": 3.0 * rows[partition]} | {"displacement": rows[partition]}
        request = driver.request(Move, partition, step=2, report="headroom", headroom_along=way, **asked)
        replies += driver.send(request)
    displaced, velocity, last = (np.zeros_like(whole.points) for _ in range(3))
    for before, reply, mesh in zip(first, replies, driver.meshes, strict=True):
        last[mesh.global_ids] = reply.displacement
        displaced[mesh.global_ids] = before.displacement + reply.displacement
        velocity[mesh.global_ids] = reply.velocity
    model, after = MotionModel.build(whole.points, cells, whole.patches, Method()), whole.points + displaced
    for reply, way, along in zip(replies, (displaced, velocity, last), ways, strict=True):
        expected = model.headroom(after - way, after, np.arange(len(cells)), step=along == "step")
        assert reply.headroom["along"] == along
        assert reply.headroom["inversion"] == pytest.approx(expected.inversion, rel=1e-6)
        assert reply.headroom["threshold"] == pytest.approx(expected.threshold, rel=1e-3)
    driver.host.close()


@pytest.mark.parametrize(
    ("asked", "expected"),
    [
        ({"headroom_along": "displacement"}, "headroom_along = 'displacement': expected report 'headroom', got ''"),
        ({"headroom_along": "velocity", "report": "headroom"}, "headroom_along = 'velocity': expected a velocity"),
    ],
)
def test_a_way_without_a_headroom_is_refused(store: Any, asked: dict[str, str], expected: str) -> None:
    driver = driver_of(store, split_mesh(boxed(12), 1))
    driver.open()
    (refused,) = driver.send(driver.request(Move, 0, step=1, displacement=bulge(driver, 0.1)[0], **asked))
    assert refused.code == "INVALID_ARGUMENT.VALUE"
    assert expected in refused.message
    driver.host.close()


@pytest.fixture
def ticking(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    read = [0]

    def monotonic() -> float:
        read[0] += 1
        return float(read[0])

    monkeypatch.setattr(stopwatch, "time", SimpleNamespace(monotonic=monotonic, perf_counter=time.perf_counter))
    return read


DEMANDING = {"quality_threshold": 0.9, "refuse_below_threshold": True}


def test_a_limit_of_computing_ends_any_move_and_changes_nothing(store: Any, ticking: list[int]) -> None:
    """The limit may end any point of the computation: the refusal names it, with the same fraction or none."""
    driver = driver_of(store, [boxed(12)], **DEMANDING)
    driver.open()
    trial = driver.all(Move, bulge(driver, 0.01), step=1)[0]
    before = ticking[0]
    unlimited = driver.all(Move, bulge(driver, 0.4), step=1)[0]
    readings = ticking[0] - before
    assert unlimited.details["fraction"] > 0.0
    ends = set()
    for seconds in np.linspace(1, readings + 1, 8, dtype=int).tolist():
        reply = driver.all(Move, bulge(driver, 0.4), step=1, compute_limit_ms=1000 * seconds)[0]
        ends.add((reply.code, reply.details.get("fraction")))
    assert ends == {
        ("DEADLINE_EXCEEDED", None),
        ("FAILED_PRECONDITION.QUALITY", None),
        ("FAILED_PRECONDITION.QUALITY", unlimited.details["fraction"]),
    }
    assert driver.ask(Status).state == "TRIAL"
    assert driver.ask(Status).iteration == trial.iteration == 1


def test_the_shortest_limit_of_the_partitions_counts(store: Any, ticking: list[int]) -> None:
    driver = driver_of(store, split_mesh(boxed(12), 3), **DEMANDING)
    driver.open()
    rows, replies = bulge(driver, 0.4), []
    for partition, limit in enumerate((0, 1000, 10**9)):  # 0: none
        fields = {"step": 1, "compute_limit_ms": limit, "displacement": rows[partition]}
        replies += driver.send(driver.request(Move, partition, **fields))
    assert [reply.code for reply in replies] == ["DEADLINE_EXCEEDED"] * 3
    assert "1 s" in replies[0].message
