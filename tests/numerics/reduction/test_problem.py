"""Reduction problems: their refusals, and the table of algorithms."""

import numpy as np
import pytest
from mesh_motion_numerics.method import KEYS
from mesh_motion_numerics.reduction import REDUCTIONS, ReductionProblem
from mesh_motion_protocol.errors import InvalidInput

POINTS = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
MOVED = np.array([[0.0, 0.1], [0.3, 0.4], [-0.5, 0.0]])


def test_points_that_coincide_are_named() -> None:
    with pytest.raises(InvalidInput, match="control points 1 and 2 coincide"):
        ReductionProblem(POINTS[[0, 1, 1]], MOVED, support_radius=2.0)


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


def test_the_table_is_what_the_method_offers() -> None:
    assert KEYS["reduction"].choices == ("none", *REDUCTIONS)
