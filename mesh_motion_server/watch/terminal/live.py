"""The live view: repeats the table on the terminal's alternate screen until ``q``."""

import os
import select
import signal
import sys
import termios
import time
import tty
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType

from mesh_motion_protocol.errors import SessionError
from rich.live import Live

from mesh_motion_server.watch.terminal.console import console
from mesh_motion_server.watch.terminal.sources import FolderSource, Unreadable
from mesh_motion_server.watch.terminal.table import Look, look_at, rendered, without_server

#: 128 + SIGHUP, as shells report a process that its terminal has ended.
_HUNG_UP = 129
#: Rows below the list: the details of one session.
_ROWS_OF_DETAILS = 20


def watch(source: FolderSource, session: str | None, every: float) -> int:
    """Show the sessions every ``every`` seconds; return the exit status.

    If a session does not exist yet, or the folder is gone, the view waits for it.
    """
    screen, keyboard = console(), sys.stdin.fileno()
    look, read_at = Look([]), 0.0
    with _single_keys(keyboard), Live(console=screen, screen=True, auto_refresh=False) as live:
        signal.signal(signal.SIGTERM, _end)  # Live then restores the normal screen
        while True:
            trouble = ""
            try:
                look, read_at = look_at(source, session), time.time()
            except (Unreadable, SessionError) as error:
                trouble = str(error)
                look = without_server(look, read_at) if isinstance(error, Unreadable) else look
            rows = max(screen.height - _ROWS_OF_DETAILS, 3)
            live.update(rendered(f"{source.where} (q quits)", look, trouble, rows), refresh=True)
            if select.select([keyboard], [], [], every)[0] and b"q" in _pressed(keyboard):
                return 0


def _pressed(keyboard: int) -> bytes:
    """Read pressed keys; end the process if the terminal is gone, because it cannot be restored."""
    with suppress(OSError):
        if keys := os.read(keyboard, 64):
            return keys
    os._exit(_HUNG_UP)


def _end(number: int, frame: FrameType | None) -> None:
    del frame
    sys.exit(128 + number)


@contextmanager
def _single_keys(keyboard: int) -> Iterator[None]:
    """Read keys as they are pressed, without showing them."""
    before = termios.tcgetattr(keyboard)
    tty.setcbreak(keyboard)
    try:
        yield
    finally:
        termios.tcsetattr(keyboard, termios.TCSADRAIN, before)
