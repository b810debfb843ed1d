"""The quality report of a later coupling iteration has only the values that decide, and they are exact too."""

from typing import Any

import numpy as np
from mesh_motion_protocol.messages import Commit, Move, Rollback
from real_sessions import new_session

from mesh_motion_server.service.reports import shortened
from tests.faults.driver import SESSION
from tests.faults.stand_in import grid_mesh

SUMMARY = {"size", "skew", "size_skew", "metric", "inverted", "cells", "worst"}


def opened(store: Any, session: str = SESSION, **settings: Any) -> Any:
    driver = new_session(store, [grid_mesh()], session, **settings)
    driver.open()
    return driver


def pushed(driver: Any, by: float) -> list[Any]:
    return [np.full((len(own), 2), (by, 0.3 * by)) for own in driver.moving]


def test_later_iterations_leave_the_distributions_to_the_commit(store: Any, tmp_path: Any) -> None:
    pair = opened(store)
    for step in (1, 2):
        (first,) = pair.all(Move, pushed(pair, 0.01), step=step)
        assert set(first.quality["corrected"]) == SUMMARY
        (later,) = pair.all(Move, pushed(pair, 0.02), step=step)
        for name in ("standard", "corrected"):
            assert set(later.quality[name]) == {"metric", "inverted", "cells", "worst"}
            assert set(later.quality[name]["metric"]) == {"min"}
        (committed,) = pair.all(Commit, step=step)
        assert set(committed.quality) == SUMMARY
        for name in ("inverted", "cells", "worst"):
            assert later.quality["corrected"][name] == committed.quality[name]
        assert later.quality["corrected"]["metric"]["min"] == committed.quality["metric"]["min"]
    pair.host.close()


def test_after_a_rollback_the_first_is_given_in_full(store: Any) -> None:
    pair = opened(store)
    pair.all(Move, pushed(pair, 0.01), step=1)
    pair.all(Move, pushed(pair, 0.01), step=1)
    pair.all(Rollback, step=1)
    (first,) = pair.all(Move, pushed(pair, 0.01), step=1)
    assert set(first.quality["standard"]) == SUMMARY
    pair.host.close()


def test_displacement_and_refusal_do_not_depend_on_it(store: Any) -> None:
    replies = []
    for session, pushes in ("3" * 32, (0.01, 0.25)), ("4" * 32, (0.25,)):
        pair = opened(store, session, quality_threshold=0.5, correction="optimised")
        for by in pushes:
            (moved,) = pair.all(Move, pushed(pair, by), step=1)
        (refused,) = pair.all(Move, pushed(pair, 3.0), step=1)
        replies.append((moved, refused))
        pair.host.close()
    (moved, refused), (first, first_refused) = replies
    assert set(moved.quality["corrected"]) < set(first.quality["corrected"])
    assert moved.displacement.tobytes() == first.displacement.tobytes()
    assert moved.correction == first.correction
    assert moved.warnings == first.warnings
    assert (refused.code, refused.message, refused.details) == (
        first_refused.code, first_refused.message, first_refused.details,
    )  # fmt: skip


def test_a_list_of_warnings_ends_with_the_number_of_the_others() -> None:
    """A header holds at most 256 items: 100 warnings and one line."""
    many = [f"warning {number}" for number in range(250)]
    assert shortened(many[:100]) == many[:100]
    assert shortened(many) == [*many[:100], "and 150 more"]


def test_headroom_beyond_the_horizon_is_left_out(store: Any) -> None:
    pair = opened(store)
    (moved,) = pair.all(Move, pushed(pair, 0.0), step=1, report="headroom")
    assert moved.headroom == {"along": "step"}
    pair.host.close()
