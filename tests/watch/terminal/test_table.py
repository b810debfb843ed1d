"""Text of a terminal, and one view of the sessions as a table."""

import json
import time
import unicodedata
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

import pytest
from mesh_motion_protocol.errors import SessionError
from rich.console import Console

from mesh_motion_server.watch.observation.verdict import Verdict
from mesh_motion_server.watch.terminal.sources import FolderSource
from mesh_motion_server.watch.terminal.table import Look, look_at, rendered, values_of, without_server
from mesh_motion_server.watch.terminal.text import number, plain

MakeSession = Callable[..., Path]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("flap", "flap"),
        ("a\x1b[2Jb\x07", "a�[2Jb�"),
        ("a\nb\tc\r", "a b c "),
        ("left\u202etfel", "left�tfel"),
        ("\x9b31m\u2028\ud800\u200b", "�31m���"),
        ("e\u0301" + "\u0301" * 40, "e\u0301\u0301"),
        ("Flügel 翼", "Flügel 翼"),
        ("12\u202f000\u00a0m", "12\u202f000\u00a0m"),
    ],
)
def test_no_control_character_reaches_the_terminal(text: str, expected: str) -> None:
    assert plain(text) == expected


def test_every_character_there_is() -> None:
    shown = plain("".join(map(chr, range(0x110000))))
    assert {unicodedata.category(letter) for letter in shown}.isdisjoint({"Cc", "Cf", "Cs", "Zl", "Zp"})


def test_numbers() -> None:
    assert (number(None), number(float("nan")), number(0.12345)) == ("–", "–", "0.123")


def shown(look: Look, most_rows: int | None = None, width: int = 80) -> list[str]:
    console = Console(width=width, no_color=True)
    with console.capture() as capture:
        console.print(rendered("state", look, most_rows=most_rows))
    return capture.get().splitlines()


def test_a_look_has_the_list_and_the_details_of_the_chosen_one(make_session: MakeSession, tmp_path: Path) -> None:
    make_session("flap\x1b[31m", steps=120)
    make_session("wing", steps=7, live=False)
    rows = shown(look_at(FolderSource(tmp_path / "state"), "flap\x1b[31m"), width=120)
    assert rows[0] == "state: 2 sessions"
    assert [row[0] for row in rows[2:4]] == ["●", "○"]
    assert "flap�[31m" in rows[2]
    text = "\n".join(rows)
    for wanted in ("size-skew  minimum 0.", "threshold 0.2; the lowest is 0.", "worst  0.", "refused MOVE"):
        assert wanted in text, wanted
    assert "\x1b" not in text


def test_the_verdict_is_the_first_thing_said_of_a_session(make_session: MakeSession, tmp_path: Path) -> None:
    folder = make_session("flap", steps=20)
    refused = {"at": time.time(), "event": "refused", "request": "MOVE", "step": 21, "code": "X", "message": "too far"}
    with max((folder / "history").iterdir()).open("a") as file:
        file.write(json.dumps(refused | {"details": {"fraction": 0.5}}) + "\n")
    look = look_at(FolderSource(tmp_path / "state"), None)
    rows = shown(look)
    assert rows[2].split()[:3] == ["●", "flap", "refused"]
    assert rows[5].startswith("refused for ")
    assert "step 21: too far; 50 % of the motion would pass" in rows[5]
    assert values_of("state", look)["sessions"][0]["verdict"]["kind"] == "refused"
    rows = shown(without_server(look, time.time()))
    assert "server gone" in rows[2]
    assert "this is the last known state" in rows[5]


def test_a_long_list_shows_the_rows_around_the_chosen_one() -> None:
    known = {"worker": "alive", "final_step": 0, "committed_at": None, "minimum": None, "changed_at": None}
    stands = {"verdict": asdict(Verdict("running", "good", "", 0.0))}
    lines = [{"session": f"{i:032x}", "label": f"s{i}", "step": i} | known | stands for i in range(50)]
    rows = shown(Look(lines, 30), most_rows=5)
    assert [row.split()[1] for row in rows[2:7]] == ["s28", "s29", "s30", "s31", "s32"]
    rows = shown(Look(lines, 49), most_rows=5)
    assert [row.split()[1] for row in rows[2:7]] == ["s45", "s46", "s47", "s48", "s49"]


def test_a_session_is_chosen_by_label_then_by_the_begin_of_its_id(make_session: MakeSession, tmp_path: Path) -> None:
    make_session("a2")  # its id begins with a1
    make_session("b")  # a2
    source = FolderSource(tmp_path / "state")
    chosen = [look_at(source, wanted) for wanted in ("a2", "a1", "b")]
    assert [look.sessions[look.chosen]["label"] for look in chosen] == ["a2", "a2", "b"]
    with pytest.raises(SessionError, match=r"no session 'c'; there are a2, b"):
        look_at(source, "c")


def test_values_hold_no_nan(make_session: MakeSession, tmp_path: Path) -> None:
    folder = make_session(steps=12)
    values = values_of("state", look_at(FolderSource(tmp_path / "state"), None))
    assert values["sessions"][0]["step"] == 12
    assert values["chosen"]["session"] == folder.name
    assert values["chosen"]["last"]["step"] == 12
    assert values["chosen"]["lowest"].keys() == {"step", "minimum"}
    json.dumps(values, allow_nan=False)
    assert values_of("state", Look([])) == {"where": "state", "sessions": []}
