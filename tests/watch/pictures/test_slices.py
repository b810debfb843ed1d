import numpy as np
import pytest
from mesh_motion_numerics.mesh.cells import CellTable
from tiny_meshes import tiny_meshes

from mesh_motion_server.watch.pictures.slices import cut, flat

SOLIDS = {name: mesh for name, mesh in tiny_meshes(3) if mesh[0].shape[1] == 3}


def area(polygon: np.ndarray) -> float:
    x, y = polygon.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


@pytest.mark.parametrize("name", SOLIDS)
@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("position", [0.123, 0.5, 0.8])
def test_the_cut_cells_fill_the_section_of_the_cube(name: str, axis: int, position: float) -> None:
    points, cells = SOLIDS[name]
    polygons = cut(points, cells, axis, position)
    areas = np.array([area(polygon) for polygon in polygons.corners])
    assert (areas >= 0).all()  # a plane through the apex of a pyramid leaves a point of it
    assert areas.sum() == pytest.approx(1.0, rel=1e-12)


def test_a_plane_through_nodes_cuts_once_not_twice() -> None:
    points, cells = SOLIDS["hexahedron"]
    on_nodes = float(np.unique(points[:, 2])[1])
    assert sum(area(polygon) for polygon in cut(points, cells, 2, on_nodes).corners) == pytest.approx(1.0)


def test_cells_keep_their_numbers() -> None:
    points, cells = SOLIDS["tetra"]
    heights = points[cells.blocks[0].nodes][:, :, 2]
    crossed = np.flatnonzero((heights.min(axis=1) < 0.4) & (heights.max(axis=1) > 0.4))
    np.testing.assert_array_equal(cut(points, cells, 2, 0.4).cells, crossed)


def test_a_plane_outside_the_mesh_cuts_nothing() -> None:
    points, cells = SOLIDS["tetra"]
    assert len(cut(points, cells, 0, 2.0).corners) == 0


def test_flat_cells_are_their_own_polygons() -> None:
    points = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [2.0, 0.5]])
    table = CellTable.from_arrays({"quad": np.array([[0, 1, 2, 3]]), "triangle": np.array([[1, 4, 2]])})
    polygons = flat(points, table)
    np.testing.assert_array_equal(polygons.cells, [0, 1])
    np.testing.assert_array_equal(polygons.corners, points[[[1, 4, 2, 2], [0, 1, 2, 3]]])
