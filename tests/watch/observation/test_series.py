"""Columns by step: given values, thinned values, repeated steps."""

import numpy as np
import pytest
from histories import largest_angle, lowest_quality, made_up_events, resumed_at

from mesh_motion_server.watch.observation.series import PHASES, Series


def test_each_step_has_what_was_given() -> None:
    columns = Series(made_up_events(300)).columns()
    assert columns["step"].tolist() == list(range(1, 301))
    assert [len(Series(made_up_events(few)).columns(10)["step"]) for few in (0, 5)] == [0, 5]
    np.testing.assert_allclose(columns["standard_min"], [lowest_quality(step) for step in range(1, 301)])
    assert (columns["predicted_min"] >= columns["standard_min"]).all()
    assert (columns["actual_p1"] > columns["actual_min"]).all()
    assert columns["iterations"].tolist() == [3 if step % 97 == 0 else 2 for step in range(1, 301)]
    assert np.flatnonzero(columns["refusals"]).tolist() == [96, 193, 290]
    assert np.flatnonzero(columns["rollbacks"]).tolist() == [96, 193, 290]
    corrected = columns["standard_min"] < 0.2
    assert corrected.any()
    assert (columns["enrichment_points"] == 3 * corrected).all()
    np.testing.assert_allclose(columns["non_orthogonality"], [largest_angle(step) for step in range(1, 301)])
    for phase in PHASES:
        assert (columns[f"seconds_{phase}"] >= 0).all()
    assert (np.diff(columns["at"]) > 0).all()


def test_faces_are_those_of_the_last_move_or_not_known() -> None:
    events = list(made_up_events(3))
    moves = [event for event in events if event["event"] == "moved"]
    moves[0]["faces"] = moves[1].pop("faces")  # of a trial that was not committed
    angles = Series(events).columns()["non_orthogonality"]
    assert np.isnan(angles).tolist() == [True, False, False]


def test_percentiles_are_those_of_the_first_move_where_later_ones_have_none() -> None:
    events = list(made_up_events(3))
    for event in events:
        if event["event"] == "moved" and event["iteration"] == 2:
            event["quality"]["corrected"]["metric"] = {"min": 0.125}
    columns = Series(events).columns()
    assert columns["predicted_min"].tolist() == [0.125] * 3
    assert np.isfinite(columns["predicted_p5"]).all()


def test_null_is_not_a_number() -> None:
    events = list(made_up_events(1))
    events[-1]["quality"]["metric"] = {"min": None}
    columns = Series(events).columns()
    assert np.isnan(columns["actual_min"][0])
    assert np.isnan(columns["actual_mean"][0])


@pytest.mark.parametrize("most", [1, 2, 7, 100, 999])
def test_thinning_loses_no_minimum_and_no_refusal(most: int) -> None:
    series = Series(made_up_events(1000))
    whole, thin = series.columns(), series.columns(most)
    assert {len(column) for column in thin.values()} == {most}
    assert thin["actual_min"].min() == whole["actual_min"].min()
    assert thin["refusals"].sum() == whole["refusals"].sum()
    assert (np.diff(thin["step"]) > 0).all()
    for row, step in enumerate(thin["step"].astype(int)):
        assert thin["actual_min"][row] == whole["actual_min"][step - 1]


@pytest.mark.parametrize("most", [3, 40])
def test_thinning_keeps_what_sticks_out_in_a_step_that_it_leaves_out(most: int) -> None:
    series = Series(made_up_events(1000))
    whole = series.columns()
    for name in ("iterations", "inverted", "seconds_correct", "seconds_total"):
        series._table[567, list(whole).index(name)] = 77.0
    for name in ("predicted_min", "standard_min"):
        series._table[567, list(whole).index(name)] = -77.0
    series._table[100, list(whole).index("predicted_min")] = np.nan  # not given
    thin = series.columns(most)
    assert 568 not in thin["step"]
    for name, value in {"iterations": 77, "inverted": 77, "seconds_correct": 77, "seconds_total": 77}.items():
        assert thin[name].max() == value
    assert (thin["predicted_min"].min(), thin["standard_min"].min()) == (-77, -77)


def test_a_refusal_is_one_of_a_motion() -> None:
    events = list(made_up_events(2))
    others = [
        {"event": "refused", "at": 0.0, "step": 2, "request": name} for name in ("JOIN", "FETCH", "COMMIT", "MOVE")
    ]
    assert Series([*events[:-1], *others, events[-1]]).columns()["refusals"].tolist() == [0, 1]


def test_steps_that_a_crash_took_are_gone_and_leave_nothing_to_those_made_again() -> None:
    events = list(made_up_events(13))
    lost = [event for event in events if event.get("step") != 13 or event["event"] == "moved"]
    series = Series([*lost, resumed_at(4)])
    assert series.columns()["step"].tolist() == [1, 2, 3, 4]
    for event in (event for event in events if event.get("step") == 5):
        series.add(event)
    columns = series.columns()
    assert columns["step"].tolist() == [1, 2, 3, 4, 5]
    assert columns["iterations"].tolist() == [2] * 5


def test_iterations_before_a_gap_do_not_count_for_the_step_after_it() -> None:
    events = [event for event in made_up_events(9) if event.get("step", 0) < 5 or event.get("step") == 8]
    begun = next(event for event in made_up_events(5) if event.get("step") == 5)
    events.insert(next(number for number, event in enumerate(events) if event.get("step") == 8), begun)
    assert Series(events).columns()["iterations"].tolist() == [2] * 5


def test_events_of_another_version_are_skipped() -> None:
    events = list(made_up_events(6))
    strange = [{"event": "moved", "at": 0.0, "step": 3}, {"event": "committed", "at": 0.0}, {"event": "refused"}]
    found = Series([*events[:-1], *strange, events[-1]]).columns()
    assert found["step"].tolist() == [1, 2, 3, 4, 5, 6]


def test_refusals_of_the_step_that_is_open_are_counted() -> None:
    refused = [{"event": "refused", "at": 0.0, "step": 1, "request": name} for name in ("MOVE", "JOIN", "MOVE")]
    assert Series(refused).open_refusals == 2
