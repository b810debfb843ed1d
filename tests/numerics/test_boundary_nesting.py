"""Parts of a boundary on the wrong side of each other: bodies beyond a wall, bodies inside each other, and valid
cases.
"""

import numpy as np
import pytest
from box_meshes import CELL_KINDS, box_mesh
from correction_cases import stored
from frame_meshes import rotation
from mesh_motion_numerics.mesh.boundary_facets import boundary_facets
from mesh_motion_numerics.motion.boundary_nesting import contact_place, misplaced_place


@pytest.mark.parametrize("kind", [kind for kind in CELL_KINDS if kind != "tetra"])  # its boxes do not fit together
@pytest.mark.parametrize(("degrees", "shift", "leaves"), [(180.0, 0.2, False), (30.0, 0.9, True), (0.0, -2.0, True)])
def test_a_body_beyond_the_wall_is_found(kind: str, degrees: float, shift: float, leaves: bool) -> None:
    mesh = box_mesh(kind, 5)
    moved = mesh.points.copy()
    x = moved[mesh.body] - 0.5
    x[:, :2] = x[:, :2] @ rotation(degrees).T
    x[:, 0] += shift
    moved[mesh.body] = x + 0.5
    prescribed = np.zeros(len(moved), dtype=bool)
    prescribed[mesh.body] = prescribed[mesh.outer] = True
    facets = boundary_facets(mesh.cells)
    place = misplaced_place(facets, prescribed, mesh.body, mesh.points, moved)
    assert (place is not None) == leaves
    prescribed[mesh.outer[0]] = False  # a wall with a node of unknown position proves nothing
    if mesh.outer[0] in np.concatenate([nodes.ravel() for nodes in facets.values()]):
        assert misplaced_place(facets, prescribed, mesh.body, mesh.points, moved) is None


def test_a_body_in_another_one_is_found_and_one_behind_it_is_not() -> None:
    mesh = stored("correction_two_blocks")
    facets, prescribed = boundary_facets(mesh.cells), mesh.held
    left = mesh.body[mesh.points[mesh.body, 0] < np.mean(mesh.points[mesh.body, 0])]
    right = np.setdiff1d(mesh.body, left)
    apart = mesh.points[right].mean(axis=0) - mesh.points[left].mean(axis=0)
    for factor, size, inside in ((1.0, 0.5, True), (0.1, 1.0, False)):
        moved = mesh.points.copy()
        centre = moved[left].mean(axis=0)
        moved[left] = centre + factor * apart + size * (moved[left] - centre)
        assert (misplaced_place(facets, prescribed, mesh.body, mesh.points, moved) is not None) == inside


@pytest.mark.filterwarnings("error")
def test_facets_that_touch_are_not_judged_where_other_nodes_follow() -> None:
    mesh = box_mesh("quad", 4)
    facets = boundary_facets(mesh.cells)
    touching = next(iter(facets.values()))[:2]
    none = np.zeros(len(mesh.points), dtype=bool)
    assert contact_place(facets, touching, none, mesh.points, mesh.points) is None
