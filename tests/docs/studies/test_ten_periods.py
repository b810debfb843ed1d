"""Periods of a motion by another system are measured as ours are."""

import numpy as np
import pytest

from docs.studies.beyond.smooth_in_time import flag, turning
from docs.studies.run.ten_periods import play, play_peer


def test_the_same_motion_by_another_system_has_the_same_figures() -> None:
    """Plain interpolation from step to step, with the radius of the other system."""
    case = turning("thesis_block", 20.0)
    plain = {"displacement": "relative", "correction": "none", "support_radius": 2.5}
    ours, theirs = play(case, plain, 1), play_peer(case, "dense-rbf", 1)
    assert theirs.qualities == pytest.approx(ours.qualities, rel=1e-6)
    assert theirs.rest == pytest.approx(ours.rest, rel=1e-6)
    assert (theirs.step, theirs.second) == pytest.approx((ours.step, ours.second), rel=1e-6)


def test_the_ends_of_the_flag_are_on_the_cylinder_too() -> None:
    """Neither of the two faces there has all its nodes in one patch."""
    mesh = flag().mesh
    assert len(np.intersect1d(mesh.outer, mesh.bodies["flag"])) == 2
