"""``mesh-motion inspect --follow`` as a program: pipes, dumb terminals, a real terminal, a real server."""

import fcntl
import json
import os
import pty
import re
import select
import signal
import struct
import subprocess
import sys
import termios
import time
from pathlib import Path

import pytest
from histories import write_history
from programs import mesh_motion

from mesh_motion_server.session.store import SessionStore
from tests.faults.driver import make_driver
from tests.faults.stand_in import grid_mesh

_PATIENCE = 90.0
NASTY = "wing \x1b[31mred\x07"


@pytest.fixture
def state(tmp_path: Path) -> Path:
    """A dead server's folder with one session of 120 steps."""
    driver = make_driver(SessionStore(tmp_path), [grid_mesh()], spec={"label": NASTY})
    driver.open()
    driver.host.close()
    (folder,) = (tmp_path / "sessions").iterdir()
    for file in (folder / "history").iterdir():
        file.unlink()
    (folder / "history").rmdir()
    write_history(folder, 120)
    return tmp_path


def run(*arguments: object, **environment: str) -> tuple[int, str, str]:
    return mesh_motion("inspect", "--follow", *arguments, env=os.environ | environment)


def test_a_pipe_gets_one_look_as_plain_text(state: Path) -> None:
    status, out, errors = run(state)
    assert (status, errors) == (0, "")
    assert "\x1b" not in out
    assert "\x07" not in out
    for wanted in (
        ": 1 session\n",
        "no process holds a session",
        "wing �[31mred�",
        "at rest",
        "the lowest is",
        "refused MOVE",
    ):
        assert wanted in out, wanted
    assert all(len(line) <= 100 for line in out.splitlines()[2:])


def test_json_has_what_a_program_needs(state: Path) -> None:
    status, out, _ = run(state, "--json")
    assert status == 0
    values = json.loads(out)
    assert values["sessions"][0]["label"] == NASTY
    assert values["chosen"]["read"] == 1
    assert values["chosen"]["last"]["step"] == 120
    assert {message["event"] for message in values["chosen"]["notable"]} == {"refused", "warning"}


@pytest.mark.parametrize(
    ("arguments", "status", "said"),
    [
        (["/no/such/folder"], 69, "/no/such/folder: the folder is not there (yet)"),
        (["tcp://127.0.0.1:7440"], 2, "expected the state folder of a server, not its endpoint"),
        (["--endpoint", "tcp://127.0.0.1:7440"], 2, "expected the state folder of a server, not its endpoint"),
        (["{state}", "--step", "3"], 2, "give either --step or --follow"),
        (["{state}", "--session", "absent"], 4, "no session 'absent'; there are wing"),
    ],
)
def test_wrong_arguments_are_refused_with_the_reason(state: Path, arguments: list[str], status: int, said: str) -> None:
    got, out, errors = run(*(argument.format(state=state) for argument in arguments))
    assert (got, out) == (status, "")
    assert said in errors
    assert "Traceback" not in errors


class Terminal:
    def __init__(self, *arguments: object, size: tuple[int, int] = (24, 80), **environment: str) -> None:
        self.output = ""
        self._end, inner = pty.openpty()
        fcntl.ioctl(inner, termios.TIOCSWINSZ, struct.pack("HHHH", *size, 0, 0))
        self.process = subprocess.Popen(
            [sys.executable, "-m", "mesh_motion_server", "inspect", "--follow", *map(str, arguments)],
            stdin=inner,
            stdout=inner,
            stderr=inner,
            env=os.environ | {"TERM": "xterm-256color"} | environment,
            start_new_session=True,
        )
        os.close(inner)

    def until(self, wanted: str) -> str:
        """Read until the text was written, or the program has ended."""
        deadline = time.monotonic() + _PATIENCE
        while wanted not in self.output:
            assert time.monotonic() < deadline, self.output[-2000:]
            ready, _, _ = select.select([self._end], [], [], 0.5)
            if ready:
                try:
                    self.output += os.read(self._end, 1 << 16).decode("utf-8", "replace")
                except OSError:
                    break
        return self.output

    def send(self, keys: str) -> None:
        os.write(self._end, keys.encode())

    def vanish(self) -> int:
        """Close its terminal without a signal; return the exit status."""
        os.close(self._end)
        return self.process.wait(_PATIENCE)

    def ended(self) -> int:
        self.until("no such text")
        os.close(self._end)
        return self.process.wait(_PATIENCE)


@pytest.mark.parametrize(("leave", "status"), [("q", 0), (signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_in_a_terminal_it_is_drawn_and_left(state: Path, leave: str | signal.Signals, status: int) -> None:
    terminal = Terminal(state)
    shown = terminal.until(" iterations, ")
    assert "\x1b[?1049h" in shown  # another screen, so that the first one comes back
    assert "red\x07" not in shown
    assert "\x1b[31mred" not in shown
    if isinstance(leave, str):
        terminal.send(leave)
    else:
        terminal.process.send_signal(leave)
    assert terminal.ended() == status
    assert "\x1b[?1049l" in terminal.output
    assert "Traceback" not in terminal.output


def test_without_its_terminal_it_ends(state: Path) -> None:
    """A former fault: after a hangup that it had to ignore, it ran for ever with a quarter of a core."""
    terminal = Terminal(state)
    terminal.until(" iterations, ")
    assert terminal.vanish() == 129


def test_no_color_has_none(state: Path) -> None:
    terminal = Terminal(state, NO_COLOR="1")
    terminal.until(" iterations, ")
    terminal.send("q")
    assert terminal.ended() == 0
    coloured = [code for code in re.findall(r"\x1b\[([\d;]*)m", terminal.output) if re.search(r"\b[34][0-8]\b", code)]
    assert coloured == []


def test_a_dumb_terminal_gets_one_look(state: Path) -> None:
    terminal = Terminal(state, TERM="dumb")
    assert terminal.ended() == 0
    assert "no process holds a session" in terminal.output
    assert "\x1b" not in terminal.output
