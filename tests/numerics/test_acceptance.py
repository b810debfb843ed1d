"""The search for the acceptable part of a refused displacement."""

import pytest
from mesh_motion_numerics.motion.acceptance import largest_accepted


@pytest.mark.parametrize("certain", [False, True])
@pytest.mark.parametrize("limit", [0.0, 0.005, 0.3, 0.7, 0.99])
@pytest.mark.parametrize("plain", [0.0, 0.1, 0.5])
def test_the_accepted_fraction_needs_few_trials_and_has_three_digits(limit: float, plain: float, certain: bool) -> None:
    asked: list[float] = []

    def accepts(fraction: float) -> bool:
        asked.append(fraction)
        return fraction <= limit

    valid = min(plain, limit)
    found = largest_accepted(
        accepts, lambda fraction: fraction <= valid, lambda fraction: True, whole=True, certain=certain
    )
    assert found <= limit
    assert found == 0.0 or ((certain or found in asked) and float(f"{found:.3g}") == found)
    assert found >= max(valid - 1 / 16, 0.0)
    assert len(asked) <= (2 if certain else 10)


def found(accepted: float, valid: float, possible: float = 1.0) -> float:
    return largest_accepted(
        lambda f: f <= accepted, lambda f: f <= valid, lambda f: f <= possible, whole=possible >= 1.0, certain=False
    )


def test_more_than_is_valid_without_a_correction_is_tried_first() -> None:
    assert found(1.0, 0.5) == pytest.approx(0.85, abs=0.02)
    assert found(0.8, 0.5) == pytest.approx(0.65, abs=0.02)
    assert found(0.6, 0.5) == pytest.approx(0.5, abs=0.04)
    assert found(0.1, 0.5) == pytest.approx(0.06, abs=0.02)


def test_nothing_is_tried_beyond_what_is_possible() -> None:
    assert found(1.0, 0.4, possible=0.6) == pytest.approx(0.95 * 0.6, abs=0.02)
    assert found(0.55, 0.4, possible=0.6) == pytest.approx(0.4 + 0.3 * 0.2, abs=0.03)


@pytest.mark.parametrize("possible", [0.6, 1.0])
def test_few_corrections_that_find_no_mesh_are_tried(possible: float) -> None:
    """Such a correction takes many times as long as one that finds a mesh."""
    asked: list[float] = []

    def accepts(fraction: float) -> bool:
        asked.append(fraction)
        return fraction <= 0.2

    found = largest_accepted(accepts, lambda f: f <= 0.2, lambda f: f <= possible, whole=possible == 1.0, certain=False)
    assert found == pytest.approx(0.2, abs=0.04)
    assert sum(fraction > 0.2 for fraction in asked) == (1 if possible == 1.0 else 2)


def test_where_the_boundary_allows_a_part_one_motion_is_tried() -> None:
    tried: list[float] = []

    def accepts(fraction: float) -> bool:
        tried.append(fraction)
        return True

    def valid(fraction: float) -> bool:
        raise AssertionError("no motion without a correction is needed")

    found = largest_accepted(accepts, valid, lambda fraction: fraction <= 0.6, whole=False, certain=False)
    assert tried == [found]
