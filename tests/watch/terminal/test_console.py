"""No text from outside is markup, a hyperlink or a control sequence in any output; only one module uses Rich."""

import ast
import io
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from mesh_motion_server.commands import outcome
from mesh_motion_server.watch.terminal.console import Table, console, inert, progress_bar, working

ROOT = Path(__file__).parents[3]
#: Letters of markup, emoji codes and control sequences: closing what is not open, links, styles that vanish.
_MARKUP = ["[/x]", "[link=https://example.org]a[/link]", "[coarse]", "[bold]b", ":wine_glass:"]
EVIL = [*_MARKUP, "\x1b]8;;u\x07", "\x9b31m", "a\u202eb"]
DOOR = ROOT / "mesh_motion_server" / "watch" / "terminal" / "console.py"
SOURCES = [
    path
    for name in ("mesh_motion_server", "adapters", "protocol", "tools", "benchmarks", "docs", "examples")
    for path in (ROOT / name).rglob("*.py")
    if path != DOOR
]
#: The parts of Rich that other modules may use: they make no text.
_HARMLESS = {"rich.console": {"Group", "RenderableType"}, "rich.live": {"Live"}, "rich.box": {"SIMPLE_HEAD"}}


def harmless(text: str) -> str:
    return text.translate(dict.fromkeys(map(ord, "\x1b\x07\x9b\u202e"), "�"))


def offences(source: str) -> Iterator[str]:
    """Uses of Rich, or of Click's printing, that take text unchanged."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] == "rich":
            yield from (a.name for a in node.names if a.name not in _HARMLESS.get(node.module or "", ()))
        elif isinstance(node, ast.Import):
            yield from (a.name for a in node.names if a.name.partition(".")[0] == "rich")
        elif isinstance(node, ast.Call):
            called, given = ast.unparse(node.func), {k.arg: ast.unparse(k.value) for k in node.keywords}
            if called == "typer.Typer" and given.get("rich_markup_mode") != "None":
                yield "typer.Typer whose help and errors are markup"
            if called == "Live" and "rich.live" in source and "console" not in given:
                yield "Live with a console of its own"
            if called in ("typer.echo", "typer.secho", "typer.style", "typer.prompt", "typer.confirm"):
                yield called


def test_rich_has_one_door() -> None:
    found = {str(path): list(offences(path.read_text("utf-8"))) for path in SOURCES if ".venv" not in path.parts}
    assert {path: ways for path, ways in found.items() if ways} == {}


@pytest.mark.parametrize(
    "source",
    [
        "from rich.console import Console",
        "from rich import print",
        "import rich.table",
        "from rich.text import Text",
        "app = typer.Typer(name='x')",
        "typer.echo(label)",
        "from rich.live import Live\nLive(screen=True)",
    ],
)
def test_the_rule_sees_other_ways(source: str) -> None:
    assert list(offences(source))


@pytest.mark.parametrize("text", EVIL)
def test_every_way_shows_a_text_as_it_is(text: str) -> None:
    out = io.StringIO()
    table = Table("name", text, title=text, box=None)
    table.add_row("cell", text)
    screen = console(file=out, width=100, force_terminal=True, color_system="truecolor", legacy_windows=False)
    screen.print(table)
    screen.print(inert("line", text))
    assert out.getvalue().count(harmless(text)) == 4
    assert "example.org\x1b" not in out.getvalue()
    assert "\x1b]8;" not in out.getvalue(), "a hyperlink"


@pytest.mark.parametrize("text", EVIL)
def test_spinner_and_bar_show_a_text_as_it_is(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for shown in (working, progress_bar):
        stream = io.StringIO()
        monkeypatch.setattr(sys, "stderr", stream)
        monkeypatch.setenv("FORCE_COLOR", "1")
        with shown(text) as change:  # type: ignore[operator]
            change(text) if shown is working else change(1, 2, text)
        assert harmless(text) in stream.getvalue()


@pytest.mark.parametrize("text", EVIL)
def test_lines_of_commands_show_a_text_as_it_is(text: str, capsys: pytest.CaptureFixture[str]) -> None:
    outcome.say(text)
    outcome.complain(text)
    shown = capsys.readouterr()
    assert shown.out == f"{harmless(text)}\n"
    assert shown.err == f"mesh-motion: {harmless(text)}\n"


def test_spaces_are_spaces() -> None:
    assert inert("12\u202f000\u00a0m").plain == "12\u202f000\u00a0m"


def test_labels_do_not_end_inspect(make_session: Callable[..., Path], tmp_path: Path) -> None:
    labels = [*EVIL, "12\u202f000", "Flügel 翼"]
    for label in labels:
        make_session(label, steps=2, live=False)
    program = "from mesh_motion_server.commands.cli import main; main()"
    for encoding in ("utf-8", "ascii"):
        run = subprocess.run(
            [sys.executable, "-c", program, "inspect", str(tmp_path / "state")],
            env={"PYTHONIOENCODING": encoding, "COLUMNS": "400"}, capture_output=True, check=False, timeout=60,
        )  # fmt: skip
        assert run.returncode == 0, run.stderr.decode()
        shown = run.stdout.decode(encoding)
        for label in labels:
            assert harmless(label).encode(encoding, "replace").decode(encoding) in shown
