"""The story of a step has the facts that an engineer needs."""

import json
from dataclasses import asdict
from pathlib import Path

import pytest
from histories import lowest_quality, made_up_events, put_events, resumed_at, write_history
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.cases.inspect import inspect_folder, inspect_step
from mesh_motion_server.cases.story import story_of_step
from mesh_motion_server.session.store import SessionStore
from mesh_motion_server.watch.observation.steps import digest_of_history
from tests.faults.driver import make_driver
from tests.faults.stand_in import grid_mesh


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A made-up history of 1100 steps."""
    folder = tmp_path_factory.mktemp("session")
    write_history(folder, 1100, segments=3)
    return folder


def text_of(folder: Path, step: int) -> str:
    return "\n".join(story_of_step(folder, step).lines)


def test_a_step_that_needed_no_correction(folder: Path) -> None:
    story = story_of_step(folder, 3)
    assert story.outcome == "committed"
    assert [event["event"] for event in story.events] == ["moved", "moved", "committed"]
    text = "\n".join(story.lines)
    assert text.startswith("step 3, 2026-09-21 (UTC): committed, 2 iterations; 31.0 ms in the server")
    for part in ("iteration 1: predicted minimum size-skew 0.74", "triangle ", " at (0.", "solve 1.0 ms", "p5 0.8"):
        assert part in text, part


def test_a_corrected_step_says_how_and_what_came_of_it(folder: Path) -> None:
    text = text_of(folder, 250)
    assert "predicted minimum size-skew 0.0500, corrected 0.2100, threshold 0.2" in text
    assert "correction: 'optimised': 3 enrichment points, 12 freed nodes, 4 iterations; reached" in text
    assert "committed: minimum 0.2050" in text
    for part in ("corrected 0.2100, threshold 0.2", "enrichment points at (0.", "; reached", "without correction: p1"):
        assert part in text, part


def test_a_correction_that_did_not_get_there(tmp_path: Path) -> None:
    events = list(made_up_events(250))
    moved = [event for event in events if event["event"] == "moved" and event["step"] == 250]
    for event in moved:
        event["correction"]["reached"] = False
        event["quality"]["corrected"]["metric"]["min"] = 0.125
        event["correction"]["sub_steps"] = 4
    (tmp_path / "history").mkdir()
    lines = "".join(json.dumps(event) + "\n" for event in events)
    (tmp_path / "history" / "events-00000000.jsonl").write_text(lines)
    text = text_of(tmp_path, 250)
    assert "corrected 0.1250, threshold 0.2" in text
    assert "not reached" in text
    assert "moved in 4 sub-steps" in text


def test_refusals_and_roll_backs_come_in_their_order(folder: Path) -> None:
    story, text = story_of_step(folder, 97), text_of(folder, 97)
    assert [event["event"] for event in story.events][:3] == ["moved", "rolled_back", "refused"]
    assert "3 iterations, 1 roll-back, 1 refusal;" in story.lines[0]
    assert "refused: MOVE of step 97: FAILED_PRECONDITION.QUALITY" in text
    assert "no valid mesh found: 3 of 722 cells" in text
    assert "rolled back: the trial of iteration 1 was dropped" in text
    assert "way out: move the fraction that stays valid" in text
    assert "cells: triangle 7" in text


def test_a_resumption_and_a_warning(folder: Path) -> None:
    text = text_of(folder, 1000)
    assert "resumed at step 999, epoch 2" in text
    assert "warning: a cell is nearly flat" in text


def test_a_step_that_is_made_again_has_both_lives(tmp_path: Path) -> None:
    events = list(made_up_events(6))
    again = [event for event in events if event.get("step") in (5, 6)]
    put_events(tmp_path, [*events, resumed_at(4), *again])
    story = story_of_step(tmp_path, 6)
    life = ["moved", "moved", "committed"]
    assert [event["event"] for event in story.events] == [*life, "resumed", *life]
    assert story.outcome == "committed"
    assert "resumed at step 4, epoch 2, by version 0.0.0: the crash lost this step" in "\n".join(story.lines)
    digest = digest_of_history(tmp_path)
    assert digest.spans == [(1, 6)]


def test_a_step_that_is_being_made_again_is_open(tmp_path: Path) -> None:
    events = list(made_up_events(6))
    again = next(event for event in events if event.get("step") == 5)
    put_events(tmp_path, [*events, resumed_at(4), again])
    story = story_of_step(tmp_path, 5)
    assert story.outcome == "open"
    assert story.lines[0].startswith("step 5, 2026-09-21 (UTC): not committed, 3 iterations, 1 resumption")


def test_a_step_that_a_crash_took_is_lost(tmp_path: Path) -> None:
    put_events(tmp_path, [*made_up_events(12), resumed_at(4)])
    story = story_of_step(tmp_path, 9)
    assert story.outcome == "lost"
    assert story.lines[0].startswith("step 9, 2026-09-21 (UTC): committed, and lost in a crash, 2 iterations")
    assert story_of_step(tmp_path, 4).outcome == "committed"
    assert digest_of_history(tmp_path).recorded == "steps 1 to 4"


@pytest.mark.parametrize("torn", [False, True])
def test_a_history_that_begins_late_has_no_step_before(torn: bool, tmp_path: Path) -> None:
    put_events(tmp_path, (event for event in made_up_events(12) if event.get("step", 0) >= 8), number=3)
    if torn:
        segment = tmp_path / "history" / "events-00000003.jsonl"
        segment.write_bytes(segment.read_bytes()[900:-100])
    with pytest.raises(InvalidInput, match="step 1 is not recorded; recorded are steps 8 to 1") as caught:
        story_of_step(tmp_path, 1)
    assert "the oldest events are removed first" in caught.value.hint
    story = story_of_step(tmp_path, 8)
    assert {event["step"] for event in story.events} == {8}
    assert story.outcome == "committed"


def test_a_history_that_had_ended_for_a_while_names_its_gap(tmp_path: Path) -> None:
    put_events(tmp_path, (event for event in made_up_events(12) if event.get("step", 0) not in (5, 6, 7, 9)))
    with pytest.raises(InvalidInput, match="step 6 is not recorded; recorded are steps 1 to 4, 8, 10 to 12") as caught:
        story_of_step(tmp_path, 6)
    assert "the history was interrupted" in caught.value.hint


def test_a_history_without_a_committed_step_says_so(tmp_path: Path) -> None:
    put_events(tmp_path, (event for event in made_up_events(1) if event["event"] != "committed"))
    assert digest_of_history(tmp_path).recorded == "no committed step"
    with pytest.raises(InvalidInput, match="step 2 is not recorded; recorded are no committed step"):
        story_of_step(tmp_path, 2)


def test_a_step_that_is_not_recorded_names_what_is(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match=r"step 1101 is not recorded; recorded are steps 1 to 1100$"):
        story_of_step(folder, 1101)
    with pytest.raises(InvalidInput, match="no history is recorded there"):
        story_of_step(tmp_path, 1)
    with pytest.raises(InvalidInput, match="not a session's folder"):
        inspect_step(folder, 1)


def test_a_history_in_short(folder: Path) -> None:
    digest = digest_of_history(folder)
    assert digest.spans == [(1, 1100)]
    assert (digest.refusals, digest.rollbacks) == (11, 11)
    assert digest.corrected_steps == sum(lowest_quality(step) < 0.2 for step in range(1, 1101))
    assert digest.worst_quality == 0.205
    json.dumps(asdict(digest))


def test_of_a_stored_session(tmp_path: Path) -> None:
    driver = make_driver(SessionStore(tmp_path), [grid_mesh()])
    driver.open()
    driver.advance(1)
    driver.move(2)
    driver.host.close()
    (session,) = (tmp_path / "sessions").iterdir()
    found = inspect_folder(session)
    assert found.values["history"]["spans"] == [(1, 1)]
    assert found.values["history"]["boundary_steps"] == 1
    story = inspect_step(session, 2)
    assert (story.values["session"], story.values["outcome"]) == (session.name, "open")
    json.dumps(story.values)
