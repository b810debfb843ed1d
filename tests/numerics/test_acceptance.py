"""The search for the part of a refused displacement that would do."""

import pytest

from mesh_motion_server.numerics.acceptance import largest_accepted, quick_method
from mesh_motion_server.numerics.method import Method


@pytest.mark.parametrize("limit", [0.0, 0.01, 0.3, 0.7, 0.99])
def test_the_largest_fraction_is_found_to_a_thirtysecond(limit: float) -> None:
    found = largest_accepted(lambda fraction: fraction <= limit, lambda fraction: fraction <= limit)
    assert limit - 1 / 32 < found <= limit


@pytest.mark.parametrize("limit", [0.0, 0.02, 0.4])
def test_what_the_method_itself_refuses_is_taken_back(limit: float) -> None:
    """The quick trials accept more than the method does."""
    asked: list[float] = []

    def accepts(fraction: float) -> bool:
        asked.append(fraction)
        return fraction <= limit

    found = largest_accepted(lambda fraction: fraction <= 0.8, accepts)
    assert found <= limit
    assert len(asked) <= 5


def test_a_quick_trial_asks_for_validity_only_where_that_is_accepted() -> None:
    assert quick_method(Method()).quality_threshold < 0.05
    assert quick_method(Method(refuse_below_threshold=True)).quality_threshold == Method().quality_threshold
    assert quick_method(Method(quality_threshold=-1.0)).quality_threshold == -1.0
