"""The search for the part of a refused displacement that would do."""

import pytest

from mesh_motion_server.numerics.motion.acceptance import largest_accepted


@pytest.mark.parametrize("limit", [0.0, 0.005, 0.3, 0.7, 0.99])
@pytest.mark.parametrize("plain", [0.0, 0.1, 0.5])
def test_what_is_found_is_accepted_in_few_trials_and_told_in_three_digits(limit: float, plain: float) -> None:
    asked: list[float] = []

    def accepts(fraction: float) -> bool:
        asked.append(fraction)
        return fraction <= limit

    found = largest_accepted(accepts, lambda fraction: fraction <= min(plain, limit))
    assert found <= limit
    assert found == 0.0 or (found in asked and float(f"{found:.3g}") == found)
    assert found >= max(min(plain, limit) - 1 / 16, 0.0)
    assert len(asked) <= 10


def test_more_than_is_valid_without_a_correction_is_tried_first() -> None:
    assert largest_accepted(lambda fraction: True, lambda fraction: fraction <= 0.5) == pytest.approx(0.85, abs=0.02)
    assert largest_accepted(lambda f: f < 0.8, lambda f: f <= 0.5) == pytest.approx(0.65, abs=0.02)
    assert largest_accepted(lambda f: f < 0.6, lambda f: f <= 0.5) == pytest.approx(0.5, abs=0.02)
    assert largest_accepted(lambda f: f < 0.1, lambda f: f <= 0.5) == pytest.approx(0.06, abs=0.02)
