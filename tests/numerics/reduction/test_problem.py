"""Reduction problems: what they refuse, and the table of algorithms."""

import numpy as np
import pytest

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.numerics.method import KEYS
from mesh_motion_server.numerics.reduction import REDUCTIONS, ReductionProblem, reduction_named

POINTS = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
MOVED = np.array([[0.0, 0.1], [0.3, 0.4], [-0.5, 0.0]])


@pytest.mark.parametrize(
    ("choices", "says"),
    [
        ({"points": POINTS[:, :0]}, "expected control points of shape"),
        ({"points": POINTS * [np.nan, 1.0]}, "control point 0 is not finite"),
        ({"points": POINTS[[0, 1, 1]]}, "control points 1 and 2 coincide"),
        ({"displacement": MOVED[:2]}, r"expected displacements of shape \(3, k\)"),
        ({"displacement": MOVED[:, 0]}, r"expected displacements of shape \(3, k\)"),
        ({"displacement": np.array([[0.0, np.inf], *MOVED[1:]])}, r"displacement 0 is not finite: \[0\.0, inf\]"),
        ({"basis": "spline"}, "unknown basis 'spline'"),
        ({"basis": "tps"}, "'tps' is only conditionally definite"),
        ({"basis": "qb"}, "'qb' cannot interpolate"),
        ({"support_radius": 0.0}, "finite support radius > 0, got 0.0"),
        ({"tolerance": -1e-3}, "tolerance of 0 or more, got -0.001"),
        ({"tolerance": np.nan}, "tolerance of 0 or more, got nan"),
        ({"max_points": -2}, "largest number of control points of 0 or more, got -2"),
    ],
)
def test_what_cannot_be_reduced_is_refused_in_one_line(choices: dict[str, object], says: str) -> None:
    with pytest.raises(InvalidInput, match=says) as caught:
        ReductionProblem(**{"points": POINTS, "displacement": MOVED, "support_radius": 2.0, **choices})
    assert "\n" not in str(caught.value)


def test_bounds_and_scales() -> None:
    of = ReductionProblem(POINTS, MOVED, support_radius=2.0, tolerance=0.1, max_points=7)
    assert (of.n_points, of.limit, of.largest, of.allowed_error) == (3, 3, 0.5, 0.05)
    assert of.start == 1  # as large as node 2, which comes later
    assert ReductionProblem(POINTS, MOVED, max_points=2).limit == 2


def test_the_given_arrays_are_not_kept() -> None:
    points = POINTS.copy()
    of = ReductionProblem(points, MOVED, support_radius=2.0)
    points[0] = 9.0
    assert of.points[0, 0] == 0.0


def test_the_table_names_itself_and_is_what_the_method_offers() -> None:
    assert all(name == row.name and row.source and row.summary for name, row in REDUCTIONS.items())
    assert KEYS["reduction"].choices == ("none", *REDUCTIONS)
    assert reduction_named("greedy") is REDUCTIONS["greedy"]
    with pytest.raises(InvalidInput, match=r"unknown reduction 'gready'.*known are greedy, one-point"):
        reduction_named("gready")
