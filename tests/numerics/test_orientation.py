"""Cells are read in either orientation, and used in one."""

import numpy as np
import pytest
from frame_meshes import tensor_grid
from mesh_motion_numerics.mesh.cells import CELL_TYPES, CellTable
from mesh_motion_numerics.mesh.roles import Patch
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.motion import MotionModel
from mesh_motion_numerics.quality.mesh_check import checked_mesh
from mesh_motion_numerics.quality.metrics import cell_quality, reference_sizes
from mesh_motion_numerics.quality.orientation import oriented, oriented_at_rest
from mesh_motion_protocol.errors import InvalidInput

LISTED = {1: "from right to left", 2: "clockwise", 3: "in the opposite orientation"}


def one_cell(name: str) -> np.ndarray:
    kind = CELL_TYPES[name]
    if kind.is_simplex:
        return np.hstack([np.zeros((kind.dimension, 1)), kind.ideal_array]).T
    cube = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]])
    nodes = {"quad": [0, 1, 2, 3], "wedge": [0, 1, 3, 4, 5, 7], "pyramid": [0, 1, 2, 3, 4]}.get(name, list(range(8)))
    return cube[nodes, : kind.dimension].astype(float)


def square(order: dict[int, list[int]] | None = None) -> tuple[np.ndarray, CellTable, dict[str, Patch]]:
    """A 4 × 4 grid of quadrilaterals, some in another node order; the left side moves, the others are fixed."""
    points, quads = tensor_grid(*[np.arange(5) / 4] * 2)
    for row, columns in (order or {}).items():
        quads[row] = quads[row, columns]
    x, y = points.T
    patches = {
        "left": Patch("moving", np.flatnonzero((x == 0) & (y > 0) & (y < 1))),
        "others": Patch("fixed", np.flatnonzero((x == 1) | (y == 0) | (y == 1))),
    }
    return points, CellTable.from_arrays({"quad": quads}), patches


def test_a_crossed_quadrilateral_stays_as_it_is():
    """Its area is negative and its corners have both signs: no mirror image makes it valid."""
    points = np.array([[0.0, 0.0], [2.0, 0.0], [0.0, -2.0], [1.0, 1.0]])
    cells = CellTable.from_arrays({"quad": [[0, 1, 2, 3]]})
    read = oriented(points, cells)
    assert read.sizes[0] < 0.0
    assert read.cells is cells
    assert len(read.mirrored) == 0


def test_at_rest_the_mirror_image_is_measured():
    points = one_cell("triangle")
    cells, rest = oriented_at_rest(points, CellTable.from_arrays({"triangle": [[0, 2, 1]]}))
    assert cells.blocks[0].nodes.tolist() == [[0, 1, 2]]
    assert rest.sizes.tolist() == reference_sizes(points, cells).tolist()
    assert rest.sizes[0] > 0.0


@pytest.mark.parametrize("name", CELL_TYPES)
def test_a_mirrored_cell_of_each_type_is_valid_and_the_same_cell(name):
    points = one_cell(name) * ([-1.0] + [1.0] * (CELL_TYPES[name].dimension - 1))
    cells = CellTable.from_arrays({name: np.arange(len(points))[None]})
    found = oriented(points, cells)
    assert not cell_quality(points, found.cells, found.sizes).inverted.any()
    assert sorted(found.cells.blocks[0].nodes[0]) == list(range(len(points)))
    np.testing.assert_array_equal(found.mirrored, [0])
    plural = {"tetra": "tetrahedra", "hexahedron": "hexahedra"}.get(name, name + "s")
    how = LISTED[cells.dimension]
    warning = f"1 of 1 {plural} was listed {how}; it is read as its mirror image, as solvers do"
    everything = {"all": Patch("moving", np.arange(len(points)))}
    assert checked_mesh(points, cells, everything).warnings == [warning]
    assert oriented(points, found.cells).cells is found.cells


def test_a_mixture_is_read_as_one_orientation():
    points, cells, patches = square()
    clockwise = {row: [1, 0, 3, 2] for row in (3, 7, 8)}
    _, mixed, _ = square(clockwise)
    found = checked_mesh(points, mixed, patches)
    assert found.warnings == ["3 of 16 quads were listed clockwise; they are read as their mirror image, as solvers do"]
    np.testing.assert_array_equal(found.reference_sizes, checked_mesh(points, cells, patches).reference_sizes)
    np.testing.assert_array_equal(mixed.blocks[0].nodes, square(clockwise)[1].blocks[0].nodes)  # not changed


def test_two_types_are_reported_in_one_line():
    points = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1], [2, 0.5]])
    cells = CellTable.from_arrays({"triangle": np.array([[1, 2, 4]]), "quad": np.array([[0, 1, 2, 3]])})
    (line,) = oriented(points, cells).warnings
    assert line.startswith("1 of 1 triangles was listed clockwise")
    cells = CellTable.from_arrays({"triangle": np.array([[1, 2, 4]]), "quad": np.array([[3, 2, 1, 0]])})
    assert oriented(points, cells).warnings == [
        "1 of 1 triangles and 1 of 1 quads were listed clockwise; they are read as their mirror image, as solvers do"
    ]


def test_motions_do_not_depend_on_how_cells_are_listed():
    points, cells, patches = square()
    _, mixed, _ = square({row: [0, 3, 2, 1] for row in range(0, 16, 2)})
    method = Method(quality_threshold=0.9)
    one, other = (MotionModel.build(points, table, patches, method) for table in (cells, mixed))
    targets = points[one.roles.moving] + [0.1, 0.05]
    moved = [model.move(points, targets).points for model in (one, other)]
    np.testing.assert_allclose(moved[0], moved[1], rtol=0, atol=1e-6)  # the optimiser sums in another order
    np.testing.assert_array_equal(one.summary(points).size.min, other.summary(points).size.min)


def test_a_folded_mesh_is_still_refused():
    """Its negative cells are listed like all others: mirrored, they would lie over their neighbours."""
    points = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1], [1.5, 0.5]])
    cells = CellTable.from_arrays({"triangle": np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])})
    with pytest.raises(InvalidInput, match=r"cell 1 \(triangle.*is inverted.*1 such cell of 4"):
        checked_mesh(points, cells, {"all": Patch("moving", np.arange(4))})
