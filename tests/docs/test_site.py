"""Additions of the documentation's site to the pages: navigation, parts generated from the code."""

import re
from pathlib import Path

import mesh_motion_client
import pytest
from mesh_motion_numerics.method import KEYS
from mesh_motion_protocol.errors import ERROR_CODES

from docs.site.__main__ import loads_from_elsewhere
from docs.site.index import INDEX, PAGES, toctrees
from docs.site.reference import PARTS, filled, without_parts
from mesh_motion_server.commands import outcome
from mesh_motion_server.commands.outcome import ExitStatus
from mesh_motion_server.settings import ServerSettings

ROOT = Path(__file__).parents[2]


def test_the_navigation_has_every_page_once() -> None:
    trees = toctrees((ROOT / f"{INDEX}.md").read_text(encoding="utf-8"))
    named = [line.rpartition("</")[2][:-1] for tree in trees.values() for line in tree.splitlines() if "</" in line]
    pages = {path.relative_to(ROOT).with_suffix("").as_posix() for p in PAGES for path in ROOT.glob(p)} - {INDEX}
    assert len(named) == len(set(named))
    assert set(named) == pages


def test_every_setting_and_name_is_in_the_reference() -> None:
    assert [key for key in ServerSettings.model_fields if f"| `{key}` |" not in PARTS["server-settings"]()] == []
    assert [key for key in KEYS if f"| `{key}` |" not in PARTS["method-settings"]()] == []
    client = PARTS["python-client"]()
    assert [name for name in mesh_motion_client.__all__ if not re.search(rf"^###? {name}$", client, re.M)] == []
    assert "frame: Frame = 'reference'" in client
    for line in PARTS["server-settings"]().splitlines()[2:]:
        assert line.split(" | ")[-1].strip(" |"), f"a comment after the setting says what it is: {line}"


def test_every_command_and_call_is_in_the_reference() -> None:
    commands, calls = PARTS["commands"](), PARTS["c-header"]()
    for name in ("serve", "play", "check", "inspect", "keys server", "version"):
        assert f"## mesh-motion {name}\n" in commands
    header = (ROOT / "adapters" / "c" / "include" / "mesh_motion.h").read_text(encoding="utf-8")
    assert header.count("MM_API ") - 3 <= calls.count("mm_") <= 10 * header.count("MM_API ")
    assert "mm_report_json" in calls
    assert "call move(displacement, answer, frame)" in PARTS["fortran-module"]()


def test_every_code_and_status_is_in_the_reference() -> None:
    codes, statuses = PARTS["error-codes"](), PARTS["exit-statuses"]()
    for code in ERROR_CODES:
        assert f"| `{code}` |" in codes
    assert "| `QualityRefused` |" in codes
    # a row is one line, because the reference takes it so
    said = (outcome.__doc__ or "").split("======\n")[2].splitlines()[:-1]
    assert [line.split()[0] for line in said] == [str(status.value) for status in ExitStatus]
    assert len(statuses.splitlines()) == 2 + len(ExitStatus)


def test_generated_parts_are_those_of_the_code() -> None:
    pages = {path.relative_to(ROOT): path.read_text("utf-8") for pattern in PAGES for path in ROOT.glob(pattern)}
    stale = [str(name) for name, text in pages.items() if filled(text) != text]
    assert stale == [], "`make manual` writes them"
    assert sum("<!-- generated: " in text for text in pages.values()) >= 10


def test_a_part_is_renewed_and_an_unknown_one_refused() -> None:
    page = "a\n<!-- generated: metrics -->\nbefore this\n<!-- end -->\nb\n"
    assert filled(page).startswith("a\n<!-- generated: metrics -->\n\n| metric |")
    assert "before this" not in filled(page)
    assert without_parts(page) == "a\n\n\n\nb\n"
    with pytest.raises(KeyError):
        filled("<!-- generated: nothing -->\n<!-- end -->")


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ('<script src="https://cdn.example.org/x.js"></script>', ["https://cdn.example.org/x.js"]),
        ('<link rel="stylesheet" href="//cdn.example.org/x.css">', ["//cdn.example.org/x.css"]),
        ("@import 'https://fonts.example.org/a.css';", ["https://fonts.example.org/a.css"]),
        ("p { background: url(https://a.example.org/p.png); }", ["https://a.example.org/p.png"]),
        ('<img src="p.png"><a href="https://a.example.org/"> p { background: url(p.png); }', []),
    ],
)
def test_what_a_page_loads_from_elsewhere_is_found(text: str, found: list[str]) -> None:
    assert loads_from_elsewhere(text) == found
