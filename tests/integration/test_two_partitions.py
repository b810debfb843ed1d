"""A boundary layer and periodic sides in two partitions, with their nodes in either: moved like one mesh."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from frame_meshes import rotation
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.motion import MotionModel
from mesh_motion_protocol.messages import Commit, Fetch, Move
from periodic_meshes import periodic_box, sector
from real_sessions import new_session

from docs.studies.aerofoil_grids import o_grid
from mesh_motion_server.session.partitions.meshes import PartitionMesh
from mesh_motion_server.session.store import SessionStore
from tests.faults.stand_in import split_mesh


def moved(folder: Path, mesh: Any, settings: Mapping[str, Any], goal: np.ndarray) -> np.ndarray:
    """(n, d) committed points of a mesh of quads in two parts; its moving nodes go to their goal (n, d)."""
    points, cells, patches = mesh
    whole = PartitionMesh(points, np.arange(len(points)), {"triangle": cells.blocks[0].nodes}, patches)
    parts = [replace(part, cells={"quad": part.cells["triangle"]}) for part in split_mesh(whole, 2)]
    driver = new_session(SessionStore(folder), parts, **settings)
    built = zip(parts, driver.open(), strict=True)
    displacements = [(goal - points)[part.global_ids[reply.moving_nodes]] for part, reply in built]
    replies = driver.all(Move, displacements, step=1, frame="reference") + driver.all(Commit, step=1)
    assert {reply.type for reply in replies} == {"MOVED", "COMMITTED"}, replies
    found = np.empty_like(points)
    for number, part in enumerate(parts):
        found[part.global_ids] = driver.ask(Fetch, number).points
    return found


def test_a_layer_across_partitions_moves_as_in_one_mesh(tmp_path: Path) -> None:
    settings = {"displacement": "absolute", "correction": "none", "support_radius": 2.0}
    grid = o_grid("blunt", around=48, layers=16, first=1e-3, far=8.0)
    mesh = grid.points, CellTable.from_arrays(grid.cells), grid.patches
    model = MotionModel.build(*mesh, Method(**settings))
    goal = mesh[0] @ rotation(15.0).T
    found = moved(tmp_path, mesh, settings, goal)
    np.testing.assert_allclose(found, model.move(mesh[0], goal[model.roles.moving]).points, atol=1e-12)
    layer = model.layered.layer
    np.testing.assert_allclose(found[layer.nodes], goal[layer.nodes], atol=1e-12)


@pytest.mark.parametrize(("make", "threshold"), [(periodic_box, 0.8), (sector, 0.2)])
def test_pairs_across_partitions_move_as_in_one_mesh(make: Any, threshold: float, tmp_path: Path) -> None:
    settings = {"support_radius": 0.8, "displacement": "absolute", "correction_target": "maximum"}
    mesh, settings = make("quad", 10, ends="slip"), settings | {"quality_threshold": threshold}
    model = MotionModel.build(*mesh, Method(**settings))
    goal = mesh[0] + (0.1, 0.25)
    found = moved(tmp_path, mesh, settings, goal)
    # the merged mesh has its cells in another order, and a descent stops where it gains little
    expected = model.move(mesh[0], goal[model.roles.moving]).points
    np.testing.assert_allclose(found, expected, atol=1e-12 if threshold == 0.2 else 1e-3)
    periodic = model.standard_motion.periodic
    assert np.abs(periodic.tied(found, model.roles.moving) - found).max() <= 1e-15
