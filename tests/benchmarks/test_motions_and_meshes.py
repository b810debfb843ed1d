"""The meshes and motions are what the tables say they are."""

from pathlib import Path

import numpy as np
import pytest
from mesh_motion_numerics.mesh.boundary_facets import boundary_nodes
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.quality.metrics import reference_sizes

from benchmarks.peers.meshes import load_or_build
from benchmarks.peers.motions import MOTIONS, RigidMotion


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("meshes")


@pytest.mark.parametrize(("name", "volume"), [("M1", 1 - 0.2 * 0.04), ("H1", 1 - 0.4 * 0.06 * 0.2)])
def test_a_mesh_fills_the_box_around_the_body(folder: Path, name: str, volume: float) -> None:
    mesh = load_or_build(name, folder)
    cells = CellTable.from_arrays(mesh.cells)
    sizes = reference_sizes(mesh.points, cells)
    assert (sizes > 0).all()
    assert sizes.sum() * cells.blocks[0].type.size_factor == pytest.approx(volume, rel=1e-12)
    assert not np.intersect1d(mesh.moving, mesh.fixed).size
    assert (np.union1d(mesh.moving, mesh.fixed) == boundary_nodes(cells)).all()


@pytest.mark.parametrize("name", ["T1", "T3"])
def test_a_body_stays_rigid_in_every_step_and_arrives(name: str) -> None:
    motion = MOTIONS[name]
    assert isinstance(motion, RigidMotion)
    d = len(motion.centre)
    points = np.random.default_rng(3).random((6, d))
    steps = motion.displacements(points, 7)
    assert steps.shape == (7, 6, d)
    np.testing.assert_allclose(steps[-1], motion.displacements(points, 1)[0], atol=1e-15)
    for displacement in steps:
        moved = points + displacement
        np.testing.assert_allclose(
            np.linalg.norm(moved[1:] - moved[0], axis=1), np.linalg.norm(points[1:] - points[0], axis=1)
        )


def test_t1_turns_the_centre_line_by_sixty_degrees() -> None:
    x = np.array([[0.5, 0.5], [0.6, 0.5]])
    moved = x + MOTIONS["T1"].displacements(x, 1)[0]
    np.testing.assert_allclose(moved[0], [0.3, 0.3])
    np.testing.assert_allclose(moved[1] - moved[0], 0.1 * np.array([0.5, 3**0.5 / 2]), atol=1e-15)


def test_bending_holds_the_root_and_moves_the_tip_by_equal_steps() -> None:
    x = np.array([[0.3, 0.5, 0.5], [0.5, 0.5, 0.5], [0.7, 0.5, 0.5]])
    steps = MOTIONS["T2"].displacements(x, 20)
    assert (steps[:, 0] == 0).all()
    assert (steps[..., [0, 2]] == 0).all()
    np.testing.assert_allclose(steps[:, 2, 1], 0.008 * np.arange(1, 21))
    np.testing.assert_allclose(steps[-1, 1, 1], 0.16 * 0.25 * 2.5 / 2)
    np.testing.assert_allclose(MOTIONS["T2s"].displacements(x, 3), steps[:3], atol=1e-15)
