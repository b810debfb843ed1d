"""Each fault of a mesh is refused with its name, numbers and a way out; unusual but valid features give a warning."""

from dataclasses import dataclass, field

import numpy as np
import pytest
from box_meshes import box_mesh
from mesh_motion_numerics.mesh.cells import CELL_TYPES, CellTable
from mesh_motion_numerics.mesh.roles import Patch
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.motion import MotionModel
from mesh_motion_numerics.quality.mesh_check import checked_mesh
from mesh_motion_protocol.errors import InvalidInput


@dataclass
class Mesh:
    """A 4 × 4 grid of 32 triangles on the unit square: the left side moves, the others are fixed."""

    points: np.ndarray = field(
        default_factory=lambda: np.stack(np.meshgrid(*[np.arange(5) / 4] * 2), -1).reshape(-1, 2)
    )
    cells: dict[str, np.ndarray] = field(default_factory=dict)
    patches: dict[str, Patch] = field(default_factory=dict)

    def __post_init__(self):
        i = np.arange(25).reshape(5, 5)
        a, b, c, d = i[:-1, :-1].ravel(), i[:-1, 1:].ravel(), i[1:, 1:].ravel(), i[1:, :-1].ravel()
        self.cells["triangle"] = np.concatenate([np.c_[a, b, c], np.c_[a, c, d]])
        x, y = self.points.T
        self.patches["left"] = Patch("moving", np.flatnonzero((x == 0) & (y > 0) & (y < 1)))
        self.patches["others"] = Patch("fixed", np.flatnonzero((x == 1) | (y == 0) | (y == 1)))

    def check(self) -> list[str]:
        return checked_mesh(self.points, CellTable.from_arrays(self.cells), self.patches).warnings


@pytest.fixture
def mesh() -> Mesh:
    return Mesh()


def refused(mesh: Mesh, message: str) -> InvalidInput:
    with pytest.raises(InvalidInput, match=message) as caught:
        mesh.check()
    return caught.value


def test_a_good_mesh_passes_without_a_word(mesh):
    assert mesh.check() == []


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_coordinate_that_is_no_number(mesh, value):
    mesh.points[7, 1] = mesh.points[9, 0] = value
    error = refused(mesh, f"node 7: coordinate y is {value}, expected a finite number \\(2 such nodes\\)")
    assert error.code == "INVALID_ARGUMENT.NONFINITE"
    assert error.details == {"node": 7, "axis": "y", "value": str(value), "count": 2}


@pytest.mark.parametrize("shape", [(25, 3), (50,), (0, 2)])
def test_points_of_another_dimension(mesh, shape):
    mesh.points = np.zeros(shape)
    assert refused(mesh, r"expected an array of shape \(n, 2\)").code == "INVALID_ARGUMENT.SHAPE"


@pytest.mark.parametrize(("index", "hint"), [(25, "start at 0"), (-1, ""), (2**31 - 1, "")])
def test_a_node_index_out_of_range(mesh, index, hint):
    mesh.cells["triangle"][3, 2] = index
    error = refused(mesh, rf"cell 3 \(triangle\): node index {index} is out of range, expected 0 to 24")
    assert error.code == "INVALID_ARGUMENT.MESH_DEGENERATE"
    assert error.details == {"cell": 3, "index": index, "nodes": 25}
    assert hint in error.hint


@pytest.mark.parametrize("index", [2**40, -(2**63), 2**31])
def test_a_node_index_beyond_32_bits(mesh, index):
    mesh.cells["triangle"][3, 2] = index
    error = refused(mesh, rf"'triangle', row 3: node index {index} is out of range, expected 0 to 2147483647")
    assert error.details == {"type": "triangle", "row": 3, "index": index}


def test_an_inverted_cell_is_named_with_its_determinant(mesh):
    mesh.points[6] = [-0.25, 0.25]
    error = refused(
        mesh, r"cell 4 .*is inverted or degenerate.* -0.0625,.* its size is -0.03125 \(2 such cells of 32\)"
    )
    assert error.code == "INVALID_ARGUMENT.MESH_DEGENERATE"
    assert error.details == {"cell": 4, "determinant": -0.0625, "size": -0.03125, "count": 2}


def test_a_cell_that_is_nearly_nothing_is_named_without_a_warning(mesh):
    mesh.points = np.concatenate([mesh.points, [[0.0, 0.0], [5e-324, 0.0], [0.0, 5e-324]]])
    mesh.cells["triangle"] = np.concatenate([mesh.cells["triangle"], [[25, 27, 26]]])
    assert refused(mesh, r"cell 32 .*is inverted or degenerate").code == "INVALID_ARGUMENT.MESH_DEGENERATE"


def test_a_cell_type_in_another_node_order_is_reported_as_such(mesh):
    mesh.points = np.vstack([mesh.points, [[1.25, 0], [1.25, 0.25], [1.25, 0.5]]])
    mesh.cells["quad"] = np.array([[4, 9, 25, 26], [9, 14, 26, 27]])
    assert "type 'quad'" in refused(mesh, r"cell 32 \(quad").hint


@pytest.mark.parametrize("distance", [0.0, 1e-14])
def test_boundary_nodes_at_the_same_place_are_noticed(mesh, distance):
    mesh.points = np.vstack([mesh.points, [[1.0, 0.25 + distance], [1.25, 0.25], [1.25, 0.5]]])
    mesh.cells["triangle"] = np.vstack([mesh.cells["triangle"], [[25, 26, 27]]])
    assert mesh.check()[0] == (
        "the boundary nodes 9 and 25 are at the same place; they are interpolated as one, "
        "and each has its own displacement"
    )
    mesh.points[27] = mesh.points[14] + distance
    assert "the boundary nodes 9 and 25 and 1 more pair are" in mesh.check()[0]


@pytest.mark.parametrize(
    ("patch", "message", "details"),
    [
        (
            Patch("wobbling", np.array([0])),
            "patch 'new': unknown role 'wobbling'; known are moving",
            {"role": "wobbling"},
        ),
        (Patch("fixed", np.array([], dtype=int)), "patch 'new' has no nodes", {}),
        (Patch("fixed", np.array([3, 25])), "node id 25 is out of range, expected 0 to 24", {"node": 25, "nodes": 25}),
        (Patch("fixed", np.array([3, -1])), "node id -1 is out of range", {"node": -1, "nodes": 25}),
        (Patch("fixed", np.array([3, 1, 1, 3])), "patch 'new' names node 3 twice", {"node": 3}),
        (Patch("fixed", np.array([[3]])), r"vector of integers, got shape \(1, 1\)", {}),
        (Patch("fixed", np.array([0.5])), "vector of integers, got .* float64", {}),
    ],
)
def test_unusable_patches(mesh, patch, message, details):
    mesh.patches["new"] = patch
    assert refused(mesh, message).details == {"patch": "new", **details}


def test_orphan_nodes_are_noticed(mesh):
    """Once, also if they are in a patch, as the middles of the edges of cells of second order are."""
    mesh.points = np.vstack([mesh.points, [[2.0, 2.0]]])
    mesh.patches["others"] = Patch("fixed", np.append(mesh.patches["others"].nodes, 25))
    assert mesh.check() == [
        "1 node belongs to no cell, the first is node 25; off the patches they are moved like interior nodes, "
        "and no cell judges them"
    ]


def test_odd_patches_are_noticed(mesh):
    mesh.patches["others"] = Patch("fixed", np.array([0, 1, 12, 5, 10]))
    inside, uncovered, shared = mesh.check()
    assert inside == "patch 'others': 1 node is not on the boundary of the mesh, the first is node 12"
    assert uncovered.startswith("11 boundary nodes are in no patch, the first is node 2; nothing holds them")
    assert shared == "patches 'left' (moving) and 'others' (fixed) share 2 nodes, the first is node 5; moving wins"


def test_nodes_behind_fixed_ones_rest(mesh):
    """A row of cells beyond a fixed line, like the halo of a periodic side."""
    columns, cells = mesh.points[:, 0], CellTable.from_arrays(mesh.cells)
    mesh.patches = {
        "left": Patch("moving", np.flatnonzero(columns == columns.min())),
        "line": Patch("fixed", np.flatnonzero(np.isclose(columns, np.unique(columns)[-2]))),
    }
    beyond = np.flatnonzero(columns == columns.max())
    assert np.array_equal(checked_mesh(mesh.points, cells, mesh.patches).resting, beyond)
    assert mesh.check()[-1] == (
        f"{len(beyond)} boundary nodes are in no patch, the first is node {beyond[0]}; "
        "they lie behind fixed nodes and stay where they are"
    )
    model = MotionModel.build(mesh.points, cells, mesh.patches, Method())
    moved = model.move(mesh.points, mesh.points[model.roles.moving] + [0.05, 0.02]).points
    assert np.array_equal(moved[beyond], mesh.points[beyond])
    between = np.flatnonzero((columns > columns.min()) & np.isin(np.arange(len(columns)), model.roles.all, invert=True))
    assert (moved[between] != mesh.points[between]).any(axis=1).all()


@pytest.mark.parametrize("name", ["tetra", "hexahedron", "wedge", "pyramid", "line"])
def test_every_cell_type_is_checked(name):
    kind = CELL_TYPES[name]
    d = kind.dimension
    corner = np.hstack([np.zeros((d, 1)), kind.ideal_array]).T
    if not kind.is_simplex:
        corner = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]])
        corner = {"hexahedron": corner, "wedge": corner[[0, 1, 3, 4, 5, 7]], "pyramid": corner[:5]}[name].astype(float)
    cells = CellTable.from_arrays({name: np.arange(kind.n_nodes)[None]})
    patches = {"all": Patch("moving", np.arange(kind.n_nodes))}
    assert checked_mesh(corner, cells, patches).warnings == []
    if not kind.is_simplex:
        corner[2] -= 3.0
        with pytest.raises(InvalidInput, match="inverted or degenerate"):
            checked_mesh(corner, cells, patches)


@pytest.mark.parametrize("kind", ["quad", "hexahedron"])
def test_a_motion_is_the_same_in_every_unit_or_refused(kind: str) -> None:
    mesh = box_mesh(kind, 10 if kind == "quad" else 5)
    patches = mesh.patches
    moved = {}
    for unit in (1.0, 1e-12, 1e15):
        points = unit * mesh.points
        method = Method(quality_threshold=0.9, correction_target="maximum")
        model = MotionModel.build(points, mesh.cells, patches, method)
        motion = model.move(points, points[model.roles.moving] + 0.17 * unit)
        assert motion.correction.freed_nodes
        moved[unit] = motion.points / unit
    for unit, places in moved.items():
        np.testing.assert_allclose(places, moved[1.0], atol=1e-6, err_msg=str(unit))
    for unit in (1e-18, 1e20):
        with pytest.raises(InvalidInput, match="take another unit of length"):
            checked_mesh(unit * mesh.points, mesh.cells, patches)


@pytest.mark.parametrize(("dimension", "hanging"), [(2, 4), (3, 56)])
def test_hanging_nodes_are_refused(dimension, hanging):
    """Half of the cells are divided into 2ᵈ: two short edges meet a long one."""
    points, cells = refined_half(dimension, 4)
    edge = np.flatnonzero(points[:, 0] == 0.0)
    patches = {"left": Patch("moving", edge)}
    with pytest.raises(
        InvalidInput, match=rf"node \d+ hangs: it lies on the facet of .* \({hanging} such nodes\)"
    ) as error:
        checked_mesh(points, cells, patches)
    node, facet = error.value.details["node"], points[error.value.details["nodes"]]
    assert points[node, 0] == pytest.approx(0.5)
    assert (facet.min(axis=0) <= points[node]).all()
    assert (points[node] <= facet.max(axis=0)).all()
    interface = np.flatnonzero(points[:, 0] == 0.5)
    named = checked_mesh(points, cells, patches | {"interface": Patch("fixed", interface)})  # two meshes that meet
    assert not any("hangs" in warning for warning in named.warnings)


def test_a_node_hangs_on_a_facet_whose_corners_are_all_in_patches():
    """A node in the middle of an edge of a tetrahedron: two other tetrahedra share that edge."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, -1], [0.5, 0.5, 0]], dtype=float)
    cells = CellTable.from_arrays({"tetra": np.array([[0, 1, 2, 3], [0, 5, 1, 4], [0, 2, 5, 4]])})
    patches = {"tip": Patch("moving", np.array([3])), "others": Patch("fixed", np.array([0, 1, 2, 4]))}
    with pytest.raises(InvalidInput, match=r"node 5 hangs: it lies on the facet of nodes \[0, 2, 1\]"):
        checked_mesh(points, cells, patches)


@pytest.mark.parametrize("diagonal", [(0, 2), (1, 3)])
def test_a_quad_on_two_triangles_is_refused(diagonal):
    """Two wedges stand on a hexahedron and have all of its nodes."""
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    points = np.vstack([np.column_stack([square, np.full(4, z)]) for z in (0.0, 1.0, 2.0)])
    one, other = diagonal
    halves = [[one, (one + 1) % 4, other], [one, other, (other + 1) % 4]]
    wedges = np.array([[*(np.array(half) + 4), *(np.array(half) + 8)] for half in halves])
    cells = CellTable.from_arrays({"hexahedron": np.arange(8)[None], "wedge": wedges})
    patches = {"bottom": Patch("moving", np.arange(4)), "top": Patch("fixed", np.arange(8, 12))}
    says = r"the facet of nodes \[4, 5, 6, 7\] of a cell covers the facet of nodes .* \(1 such facet\)"
    with pytest.raises(InvalidInput, match=says) as error:
        checked_mesh(points, cells, patches)
    assert "pyramids" in error.value.hint
    checked_mesh(points, cells, patches | {"between": Patch("fixed", np.arange(4, 8))})  # two meshes that meet
    edge = np.array([4, 5, 6])
    with pytest.raises(InvalidInput, match="covers the facet"):
        checked_mesh(points, cells, patches | {"between": Patch("fixed", edge)})


def refined_half(dimension, n):
    """A cube of n cells a side, those at x < 1/2 split."""
    numbers: dict[tuple[float, ...], int] = {}
    quad = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    name, corners = (
        ("quad", quad[:, :2]) if dimension == 2 else ("hexahedron", np.vstack([quad, quad + np.array([0, 0, 1])]))
    )
    rows = []
    for low in np.ndindex(*[n] * dimension):
        split = 2 if low[0] < n / 2 else 1
        for part in np.ndindex(*[split] * dimension):
            places = (np.array(low) + (np.array(part) + corners) / split) / n
            rows.append([numbers.setdefault(tuple(place), len(numbers)) for place in places.tolist()])
    return np.array(list(numbers)), CellTable.from_arrays({name: np.array(rows)})


def test_the_two_sides_of_an_interface_are_one_behind_fixed_nodes():
    """The side near the fixed wall is not held: its twin belongs to the moving side."""
    low, high = box_mesh("quad", 4), box_mesh("quad", 4)
    n = len(low.points)
    points = np.vstack([low.points, high.points + np.array([0.0, np.ptp(low.points[:, 1])])])
    (block,) = low.cells.blocks
    cells = CellTable.from_arrays({"quad": np.vstack([block.nodes, n + block.nodes])})
    ends = [np.flatnonzero(points[:, 1] == value) for value in (points[:, 1].min(), points[:, 1].max())]
    patches = {"bottom": Patch("moving", ends[0]), "top": Patch("fixed", ends[1])}
    checked = checked_mesh(points, cells, patches)
    assert len(checked.coincident) == len(ends[0])
    assert not len(checked.resting)
