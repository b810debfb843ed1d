"""The search for the acceptable part of a refused displacement."""

import pytest
from mesh_motion_numerics.motion.acceptance import largest_accepted


@pytest.mark.parametrize("limit", [0.0, 0.005, 0.3, 0.7, 0.99])
@pytest.mark.parametrize("plain", [0.0, 0.1, 0.5])
def test_the_accepted_fraction_needs_few_trials_and_has_three_digits(limit: float, plain: float) -> None:
    asked: list[float] = []

    def accepts(fraction: float) -> bool:
        asked.append(fraction)
        return fraction <= limit

    valid = min(plain, limit)
    found = largest_accepted(
        accepts, lambda fraction: fraction <= valid, lambda fraction: True, whole=True, settled=lambda: True
    )
    assert found <= limit
    assert found in (0.0, *asked) or valid - max(0.04 * valid, 0.001) <= found <= valid
    assert float(f"{found:.3g}") == found
    assert len(asked) <= 2


def found(accepted: float, valid: float, possible: float = 1.0, *, settled: bool = False) -> float:
    return largest_accepted(
        lambda f: f <= accepted,
        lambda f: f <= valid,
        lambda f: f <= possible,
        whole=possible >= 1.0,
        settled=lambda: settled,
    )


def test_more_than_is_valid_without_a_correction_is_tried_first() -> None:
    assert found(1.0, 0.5) == pytest.approx(0.85, abs=0.02)
    assert found(0.8, 0.5) == pytest.approx(0.65, abs=0.02)
    assert found(0.6, 0.5) == pytest.approx(0.5, abs=0.04)
    assert found(0.1, 0.1) == pytest.approx(0.1, abs=0.004)


def test_nothing_is_tried_beyond_what_is_possible() -> None:
    assert found(1.0, 0.1, possible=0.6) == pytest.approx(0.95 * 0.6, abs=0.02)
    assert found(0.4, 0.1, possible=0.6) == pytest.approx(0.1 + 0.3 * 0.5, abs=0.03)


@pytest.mark.parametrize("valid", [0.004, 0.02, 0.06, 0.3, 0.9])
def test_a_valid_fraction_is_exact_to_a_share_of_itself(valid: float) -> None:
    assert found(1.0, valid, possible=0.99, settled=True) == pytest.approx(valid, rel=1 / 31, abs=0.001)


@pytest.mark.parametrize("possible", [0.6, 1.0])
def test_few_corrections_that_find_no_mesh_are_tried(possible: float) -> None:
    """Such a correction takes many times as long as one that finds a mesh."""
    asked: list[float] = []

    def accepts(fraction: float) -> bool:
        asked.append(fraction)
        return fraction <= 0.2

    found = largest_accepted(
        accepts, lambda f: f <= 0.2, lambda f: f <= possible, whole=possible == 1.0, settled=lambda: False
    )
    assert found == pytest.approx(0.2, abs=0.04)
    assert len(asked) == (1 if possible == 1.0 else 2)


@pytest.mark.parametrize(("valid", "settled"), [(0.02, True), (0.3, False)])
def test_where_the_boundary_forbids_the_whole_no_correction_is_tried(valid: float, settled: bool) -> None:
    def accepts(fraction: float) -> bool:
        raise AssertionError("a correction takes as long as many answers")

    found = largest_accepted(
        accepts, lambda f: f <= valid, lambda f: f <= 0.6, whole=False, settled=lambda: settled, expected=None
    )
    assert found == pytest.approx(valid, rel=1 / 31)
