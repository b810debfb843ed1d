"""The near-surface correction: its radius, and layers that invert if only their nodes are set."""

import numpy as np
import pytest
from mesh_motion_numerics.interpolation import evaluation
from mesh_motion_numerics.interpolation.interpolant import factorize
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.quality.metrics import cell_quality, reference_sizes
from mesh_motion_numerics.reduction import REDUCTIONS, ReductionProblem
from mesh_motion_numerics.reduction.reduced_motion import boundary_spacing, near_surface_radius


def test_spacing_is_the_median_to_the_nearest() -> None:
    assert boundary_spacing(np.array([[0.0], [1.0], [3.0], [6.0], [10.0]])) == 2.0
    assert boundary_spacing(np.zeros((1, 2))) == 0.0


@pytest.mark.parametrize(
    ("spacing", "error", "widest", "radius"),
    [
        (0.1, 0.01, 5.0, 0.4),  # four spacings
        (0.1, 0.05, 5.0, 0.8),  # ten errors, in steps of two
        (0.1, 0.30, 5.0, 3.2),
        (0.1, 0.30, 2.0, 2.0),  # at most the motion's own
        (0.0, 0.30, 2.0, 2.0),  # a single moving node
    ],
)
def test_radius(spacing: float, error: float, widest: float, radius: float) -> None:
    assert near_surface_radius(spacing, error, widest) == pytest.approx(radius)


def layers(n: int = 120, count: int = 25) -> tuple[np.ndarray, CellTable]:
    """(n · (count + 1), 2) nodes in layers of quads around a thin ellipse; the first one is 0.001 thick."""
    t = 2 * np.pi * np.arange(n) / n
    body = np.column_stack([0.5 * np.cos(t), 0.08 * np.sin(t)])
    normal = np.column_stack([0.08 * np.cos(t), 0.5 * np.sin(t)])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    away = 1e-3 * (1.3 ** np.arange(count + 1) - 1.0) / 0.3
    share = (away / away[-1])[:, None, None]
    far = (away[-1] + 0.5) * np.column_stack([np.cos(t), np.sin(t)])
    points = (1 - share) * (body + away[:, None, None] * normal) + share * far
    i, j = np.arange(n), (np.arange(n) + 1) % n
    quads = [np.column_stack([k * n + i, (k + 1) * n + i, (k + 1) * n + j, k * n + j]) for k in range(count)]
    return points.reshape(-1, 2), CellTable.from_arrays({"quad": np.concatenate(quads)})


def test_thin_layers_survive_the_correction_and_not_the_setting_of_nodes() -> None:
    points, cells = layers()
    boundary = np.concatenate([np.arange(120), np.arange(len(points) - 120, len(points))])
    body = points[:120]
    moved = np.zeros((240, 2))
    moved[:120, 1] = 0.1 + 0.15 * np.sin(5.0 * body[:, 0]) ** 2
    of = ReductionProblem(points[boundary], moved, support_radius=6.0, tolerance=0.02)
    reduced = REDUCTIONS["grouped-circular"](of)
    assert len(reduced.selected) < 60

    def worst(displacement: np.ndarray) -> float:
        trial = points + displacement
        trial[boundary] = points[boundary] + moved
        return float(cell_quality(trial, cells, reference_sizes(points, cells)).metric("size-skew").min())

    plain = evaluation.displacement(reduced.levels[0], points)
    radius = near_surface_radius(boundary_spacing(body), reduced.max_error, 6.0)
    near = evaluation.displacement(factorize(of.points, support_radius=radius).solve(reduced.error), points)
    full = evaluation.displacement(factorize(of.points, support_radius=6.0).solve(moved), points)
    assert worst(plain) < 0.0
    assert worst(plain + near) > 0.9 * worst(full) > 0.2
