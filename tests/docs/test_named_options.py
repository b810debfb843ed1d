"""Each option that a page names for a command of ``mesh-motion`` exists."""

import re
from pathlib import Path

import pytest
import typer

from docs.site.reference.commands import _leaves
from mesh_motion_server.commands.app import app

ROOT = Path(__file__).resolve().parents[2]
COMMANDS = dict(_leaves(typer.main.get_command(app)))
COMMON = {"--help", "--install-completion", "--show-completion", "--version"}
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def options(name: str) -> set[str]:
    return {text for parameter in COMMANDS[name].params for text in (*parameter.opts, *parameter.secondary_opts)}


def unknown(text: str) -> list[str]:
    """The options of each ``mesh-motion COMMAND …`` in a text that do not exist."""
    found = []
    for line in re.findall(r"mesh-motion ((?:[^\n`|;&#]|\\\n)+)", text):
        words = line.split()
        name = " ".join(words[:2]) if " ".join(words[:2]) in COMMANDS else words[0] if words else ""
        if name in COMMANDS:
            known = options(name) | COMMON
            named = re.findall(r"(?<![\w-])--[a-z][a-z-]*", line)
            found += [f"{name} {option}" for option in named if option not in known]
    return found


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_a_page_names_only_options_that_there_are(page: Path) -> None:
    assert unknown(page.read_text(encoding="utf-8")) == []


def test_the_table_of_commands_names_only_options_that_there_are() -> None:
    page = (ROOT / "docs/reference/commands.md").read_text(encoding="utf-8").partition("<!-- generated")[0]
    for row in re.findall(r"^\| `mesh-motion .*$", page, re.MULTILINE):
        command = re.match(r"\| `mesh-motion (\w+)", row)
        assert command is not None
        name = command[1]
        known = COMMON.union(*(options(key) for key in COMMANDS if key.split()[0] == name))
        assert set(re.findall(r"`(--[a-z-]+)", row)) <= known, row


def test_an_option_that_is_gone_is_found() -> None:
    assert unknown("`mesh-motion play CASE.toml --variant a`") == ["play --variant"]
