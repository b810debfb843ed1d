"""The one line about a session's state: a function of its history and the time, exact."""

import time
from collections.abc import Iterable
from typing import Any

import pytest
from histories import BEGIN, made_up_events, resumed_at

from mesh_motion_server.watch.observation.verdict import Recent, Verdict, duration, server_gone, verdict

#: Seconds from one commit of :func:`_commits` to the next.
PAUSE = 4.0


def _recent(*events: Iterable[dict[str, Any]]) -> Recent:
    recent = Recent()
    for some in events:
        for event in some:
            recent.take(event)
    return recent


def _built(at: float = BEGIN) -> list[dict[str, Any]]:
    return [{"at": at, "event": "built", "settings": {"quality_threshold": 0.2}}]


def _commits(minima: Iterable[float | None]) -> list[dict[str, Any]]:
    return [
        {"at": BEGIN + PAUSE * step, "event": "committed", "step": step, "quality": {"metric": {"min": minimum}}}
        for step, minimum in enumerate(minima, start=1)
    ]


def _refusal(at: float, step: int = 4, **more: Any) -> dict[str, Any]:
    added = {"request": "MOVE", "step": step, "code": "X", "message": "3 of 722 cells are inverted", "details": {}}
    return {"at": at, "event": "refused", **added, **more}


def test_a_clock_that_is_set_back_hides_no_stall() -> None:
    """The session was built three hours ahead of its commits."""
    recent = _recent(_built(BEGIN + 10800.0), _commits([0.5] * 4))
    assert verdict(recent, BEGIN + 20.0).kind == "running"
    assert verdict(recent, BEGIN + 400.0).kind == "stalled"


def test_a_session_that_runs() -> None:
    recent = _recent(_built(), _commits([0.5, 0.6, 0.55]))
    found = verdict(recent, BEGIN + 15.0)
    assert found == Verdict("running", "good", "step 3, minimum 0.550, 900 steps an hour", BEGIN + 12.0)
    assert found.line(BEGIN + 15.0) == "running, last commit 3 s ago: step 3, minimum 0.550, 900 steps an hour"


def test_the_history_of_a_long_run_runs() -> None:
    recent = _recent(made_up_events(600))
    assert verdict(recent, recent.changed_at).kind == "running"
    assert len(recent.commits) == 32


def test_refusals_in_a_row_are_no_ready_session() -> None:
    at = BEGIN + 100.0
    added = [_refusal(at), {"at": at + 1, "event": "rolled_back", "step": 4, "iteration": 1}]
    added += [_refusal(at + 2, untold=3), _refusal(at + 4, details={"fraction": 0.629})]
    recent = _recent(_built(), _commits([0.5, 0.5, 0.5]), added)
    found = verdict(recent, at + 120.0)
    why = "6 times in a row, step 4: 3 of 722 cells are inverted; 62 % of the motion would pass"
    assert found == Verdict("refused", "bad", why, at)
    assert found.line(at + 120.0) == f"refused for 2 min: {why}"
    moved = {"at": at + 5, "event": "moved", "step": 4, "iteration": 1, "quality": {"threshold": 0.2}}
    recent.take(moved)
    assert verdict(recent, at + 6).kind != "refused"


def test_one_refusal_and_one_of_another_request() -> None:
    found = verdict(_recent(_built(), [_refusal(BEGIN + 1, request="COMMIT", step=1)]), BEGIN + 2)
    assert found.why == "COMMIT of step 1: 3 of 722 cells are inverted"


def test_below_the_threshold_since() -> None:
    recent = _recent(_built(), _commits([0.3, 0.1, 0.3, 0.19, 0.18]))
    why = "minimum 0.180 is below the threshold 0.2 since step 4"
    assert verdict(recent, BEGIN + 21.0) == Verdict("degrading", "warn", why, BEGIN + 16.0)


def test_stalled_after_ten_usual_pauses() -> None:
    recent = _recent(_built(), _commits([0.5] * 8))
    last = BEGIN + 8 * PAUSE
    assert verdict(recent, last + 40.0).kind == "running"
    found = verdict(recent, last + 41.0)
    assert found == Verdict("stalled", "bad", "no commit after step 8, usually one every 4 s", last)
    moved = {"at": last + 41, "event": "moved", "step": 9, "iteration": 5, "quality": {"threshold": 0.2}}
    recent.take(moved)
    assert verdict(recent, last + 41.0).why.endswith("; trial 5 is open")


def test_a_pause_of_a_quick_session_is_no_stall_and_a_first_step_may_take_its_time() -> None:
    recent = _recent(made_up_events(20))
    assert verdict(recent, recent.changed_at + 29.0).kind == "running"
    assert verdict(recent, recent.changed_at + 31.0).kind == "stalled"
    assert verdict(_recent(_built()), BEGIN + 1e5).kind == "running"


def test_a_session_that_was_resumed_has_its_time_and_lost_its_steps() -> None:
    recent = _recent(_built(), _commits([0.5] * 8), [resumed_at(6, BEGIN + 1000.0)])
    found = verdict(recent, BEGIN + 1030.0)
    assert (found.kind, recent.commits[-1].step) == ("running", 6)
    assert verdict(recent, BEGIN + 1050.0).since == BEGIN + 1000.0


@pytest.mark.parametrize(
    ("event", "worker", "kind", "tone"),
    [
        ({"event": "suspended", "step": 3}, "alive", "suspended", "warn"),
        ({"event": "closed", "step": 3}, "none", "closed", ""),
        ({"event": "frozen", "step": 3, "message": "disk full"}, "alive", "frozen", "bad"),
        ({"event": "failed", "step": 3, "message": "out of memory"}, "dead", "failed", "bad"),
        ({"event": "joined", "step": 3}, "dead", "worker fell", "bad"),
        ({"event": "joined", "step": 3}, "none", "at rest", ""),
    ],
)
def test_events_that_end_a_run_give_its_verdict(event: dict[str, Any], worker: str, kind: str, tone: str) -> None:
    recent = _recent(_built(), _commits([0.5] * 3), [{"at": BEGIN + 50.0, **event}])
    found = verdict(recent, BEGIN + 1e6, worker=worker)
    assert (found.kind, found.tone, found.since) == (kind, tone, BEGIN + 50.0)
    assert event.get("message", "") in found.why


def test_nothing_is_known() -> None:
    assert verdict(Recent(), BEGIN) == Verdict("no mesh yet", "", "", 0.0)
    assert verdict(Recent(), BEGIN).line(BEGIN) == "no mesh yet"
    assert server_gone(BEGIN).line(BEGIN + 3600.0) == "server gone for 60 min: this is the last known state"


def test_durations() -> None:
    added = [duration(s) for s in (-1.0, 0.25, 4.0, 4.26, 90.0, 119.0, 120.0, 7100.0, 7200.0, 86400.0, 172800.0)]
    assert added == ["0 ms", "250 ms", "4 s", "4.3 s", "90 s", "119 s", "2 min", "118 min", "2 h", "24 h", "2 days"]


def test_a_run_whose_client_names_its_end_says_when_it_is_there() -> None:
    added = [event | {"final_step": 10} for event in _commits([0.5, 0.5, 0.5])]
    found = verdict(_recent(_built(), added), BEGIN + 13.0)
    assert found.why == "step 3 of 10, minimum 0.500, 900 steps an hour"
    assert found.ends_at == BEGIN + 12.0 + 7 * PAUSE
    clock = time.strftime("%H:%M", time.localtime(found.ends_at))
    assert found.line(BEGIN + 13.0).endswith(f"900 steps an hour, ends about {clock}")
    assert verdict(_recent(_built(), added), BEGIN + 1e6).ends_at == 0.0  # stalled
    assert verdict(_recent(_built(), added), BEGIN + 13.0, worker="none").ends_at == 0.0
    last = [event | {"final_step": 3} for event in added]
    assert verdict(_recent(_built(), last), BEGIN + 13.0).ends_at == 0.0  # it is committed
    assert verdict(_recent(_built(), added, _commits([0.5] * 4)[3:]), BEGIN + 17.0).why.startswith("step 4, ")
