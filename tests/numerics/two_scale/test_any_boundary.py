"""Every set of distinct boundary nodes is interpolated with default settings, to 1e-10 before any node is set."""

from collections.abc import Iterator

import numpy as np
import pytest
from mesh_motion_numerics.interpolation.factor_source import MakeEachTime
from mesh_motion_numerics.mesh.boundary_facets import boundary_facets
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.roles import BoundaryRoles
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.standard_motion import StandardMotion, StandardTrial
from mesh_motion_numerics.quality.metrics import cell_quality, reference_sizes
from mesh_motion_numerics.stopwatch import Stopwatch
from trial_stages import displacement_by

from docs.studies.aerofoil_grids import TRAILING_EDGES, Grid, c_grid, o_grid, wing

Floats = np.ndarray


def turned(points: Floats, degrees: float, shift: float) -> Floats:
    """Points (n, d) turned about the quarter chord in the plane, and shifted along y."""
    a, moved = np.radians(degrees), points.copy()
    x, y = points[:, 0] - 0.25, points[:, 1]
    moved[:, 0] = 0.25 + np.cos(a) * x - np.sin(a) * y
    moved[:, 1] = np.sin(a) * x + np.cos(a) * y + shift
    return moved


def moved_by(grid: Grid, targets: Floats) -> tuple[StandardTrial, float]:
    """The default motion of a grid with its body at the targets (b, d), and the largest error before nodes are set.

    The error is a share of the largest displacement.
    """
    cells, roles = CellTable.from_arrays(grid.cells), BoundaryRoles.from_patches(grid.patches)
    motion = StandardMotion.build(grid.points, boundary_facets(cells), grid.patches, Method(correction="none"))
    wanted = grid.points.copy()
    wanted[grid.body] = targets
    trial = motion.trial(grid.points, wanted[roles.moving], MakeEachTime(), Stopwatch())
    nodes_known = roles.prescribed
    left = displacement_by(trial, grid.points[nodes_known]) - (wanted - grid.points)[nodes_known]
    return trial, float(np.abs(left).max() / np.abs(wanted - grid.points).max())


def aerofoils() -> Iterator[tuple[str, Grid]]:
    """Grids whose first cells are valid in double precision: near a cusp their sizes are the squares of those at
    mid-chord.
    """
    for far in (15.0, 1000.0):
        for first in (1e-3, 1e-5, 1e-8):
            for edge in TRAILING_EDGES:
                if edge == "blunt" or first > 1e-8:
                    yield f"O {edge} {first} {far}", o_grid(edge, first=first, far=far)
                if edge != "blunt":
                    yield f"C {edge} {first} {far}", c_grid(edge, first=first, far=far)


@pytest.mark.parametrize("grid", [pytest.param(grid, id=name) for name, grid in aerofoils()])
def test_aerofoils_turn_with_their_first_cells_by_45_degrees_and_half_a_chord(grid: Grid) -> None:
    trial, error = moved_by(grid, turned(grid.points[grid.body], 45.0, 0.5))
    assert error < 1e-10
    cells = CellTable.from_arrays(grid.cells)
    rest, sizes = grid.points, reference_sizes(grid.points, cells)
    now, before = cell_quality(trial.points, cells, sizes), cell_quality(rest, cells, sizes)
    assert not now.inverted.any()
    assert (now.skew / before.skew).min() > 0.78
    first = cells.blocks[0].nodes[np.isin(cells.blocks[0].nodes, grid.body).sum(axis=1) == 2]
    on_wall = np.isin(first, grid.body)
    heights = [_heights(points, first, on_wall) for points in (rest, trial.points)]
    assert (np.abs(heights[1] - heights[0]) < 0.035 * heights[0] + 1e-11).all()  # in chords: what rounding leaves


def _heights(points: Floats, cells: np.ndarray, on_wall: np.ndarray) -> Floats:
    """Lengths of the edges between a node on the wall and one off the wall, for quads (m, 4)."""
    pairs = [(cells[:, k], cells[:, (k + 1) % 4], on_wall[:, k] != on_wall[:, (k + 1) % 4]) for k in range(4)]
    return np.concatenate([np.linalg.norm(points[a[is_up]] - points[b[is_up]], axis=1) for a, b, is_up in pairs])


@pytest.mark.parametrize(
    ("edge", "first", "far"),
    [
        ("sharp", 1e-3, 15.0),
        pytest.param("cusped", 1e-3, 1000.0, marks=pytest.mark.nightly),
        pytest.param("blunt", 1e-6, 500.0, marks=pytest.mark.nightly),
    ],
)
def test_wings_turn_with_their_first_cells(edge: str, first: float, far: float) -> None:
    grid = wing(o_grid(edge, around=64, layers=28, first=first, far=far), stations=20)
    trial, error = moved_by(grid, turned(grid.points[grid.body], 20.0, 0.5))
    assert error < 1e-10
    cells = CellTable.from_arrays(grid.cells)
    sizes = reference_sizes(grid.points, cells)
    now, before = cell_quality(trial.points, cells, sizes), cell_quality(grid.points, cells, sizes)
    assert not now.inverted.any()
    assert (now.skew / before.skew).min() > 0.8


def test_two_surfaces_next_to_each_other_and_a_crowd_of_nodes_are_met_exactly() -> None:
    x = np.linspace(0.0, 1.0, 200)
    lower, upper = np.column_stack([x, 0.0 * x]), np.column_stack([x, 0.0 * x + 1e-7])
    crowd = np.array([0.5, 0.3]) + 10.0 ** -np.arange(1.0, 14.0)[:, None] * [1.0, 0.5]
    points = np.vstack([upper, crowd, lower, [[-30.0, -30.0], [30.0, 30.0], [30.0, -30.0], [-30.0, 30.0]]])
    moving = np.arange(len(upper) + len(crowd))
    quads = {"quad": np.array([[len(points) - 4, len(points) - 2, len(points) - 3, len(points) - 1]])}
    grid = Grid(points, quads, moving, np.arange(len(moving), len(points)))
    _, error = moved_by(grid, points[moving] + [0.02, 0.01] * points[moving][:, ::-1] + [0.0, 1e-8])
    assert error < 1e-10


def test_nodes_at_one_place_are_one_control_point_which_takes_their_mean() -> None:
    x = np.linspace(0.0, 1.0, 60)[:, None] * [1.0, 0.0]
    points = np.vstack([x, x, [[-3.0, -3.0], [4.0, -3.0], [4.0, 3.0], [-3.0, 3.0]]])
    quads = {"quad": np.array([[120, 121, 122, 123]])}
    grid = Grid(points, quads, np.arange(120), np.arange(120, 124))
    same = points[:120] + np.array([0.0, 0.1])
    trial, error = moved_by(grid, same)
    assert error < 1e-10
    np.testing.assert_array_equal(trial.points[:120], same)
    opened = same + np.repeat([[0.0, 0.05], [0.0, -0.05]], 60, axis=0)
    trial, _ = moved_by(grid, opened)
    np.testing.assert_array_equal(trial.points[:120], opened)
    np.testing.assert_allclose(displacement_by(trial, points[:60])[:, 1], 0.1, atol=1e-10)
