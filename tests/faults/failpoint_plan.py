"""Faults at the server's failpoints: a kill, an error or a delay, as a plan says.

The folder that :data:`mesh_motion_server.failpoints.VARIABLE` names has the file ``plan``, which may be replaced while
the server runs::

    journal.commit.slot-synced=kill@3; worker.bound=sleep:0.4@1; journal.epoch.start=raise:EIO@1

At the third passage of the first point, counted over all processes of the server, the process that passes is killed as
by ``kill -9``. ``sleep`` takes seconds, ``raise`` the name of an errno (then it is an OSError), MemoryError or
RuntimeError. Every passage of a point adds a byte to the point's file in the folder: so the count survives a killed
process, and the check sees which points were passed. Removing the files starts the count again.

:mod:`.failpoint_table` has all names, with the faults that can occur there.
"""

import errno
import os
import re
import signal
import stat
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.failpoints import VARIABLE

PLAN = "plan"

_ENTRY = re.compile(r"(?P<point>[^=\s]+)=(?P<action>kill|sleep|raise)(:(?P<value>[^@]+))?@(?P<hit>[1-9][0-9]*)")
_ERRORS: Mapping[str, type[Exception]] = {"MemoryError": MemoryError, "RuntimeError": RuntimeError}
_CODES = {name: code for code, name in errno.errorcode.items()}


@dataclass(frozen=True)
class Fault:
    """The fault at one passage of a point.

    ``action`` ({"kill", "sleep", "raise"}); ``value``: seconds, or the error's name; ``hit``: number of the passage,
    from 1.
    """

    action: str
    value: str
    hit: int

    def strike(self) -> None:
        if self.action == "kill":
            os.kill(os.getpid(), signal.SIGKILL)
        elif self.action == "sleep":
            time.sleep(float(self.value))
        elif self.value in _ERRORS:
            raise _ERRORS[self.value]("a failpoint says so")
        else:
            raise OSError(_CODES[self.value], os.strerror(_CODES[self.value]))


def of_folder(folder: Path) -> Callable[[str], None]:
    """The function that a server calls at each point, with the plan in a folder.

    Raises InvalidInput if the folder is not a folder of this user, or its plan is invalid.
    """
    if not folder.is_dir() or stat.S_IMODE(folder.stat().st_mode) & 0o077:
        raise InvalidInput(f"{VARIABLE}: {folder} is not a folder that only its owner may enter", hint="mkdir -m 700")
    active = _Active(folder)
    active.refresh()
    return active.passed


def read_plan(text: str) -> dict[str, Fault]:
    """Return the faults of a plan by point.

    Raises InvalidInput with the invalid entry.
    """
    faults = {}
    for entry in filter(None, (part.strip() for part in text.split(";"))):
        match = _ENTRY.fullmatch(entry)
        if match is None or not _sound(match["action"], match["value"] or ""):
            raise InvalidInput(
                f"failpoints: expected POINT=kill@HIT, POINT=sleep:SECONDS@HIT or POINT=raise:ERROR@HIT, got {entry!r}",
                hint=f"ERROR is an errno's name such as EIO, or {' or '.join(_ERRORS)}",
            )
        faults[match["point"]] = Fault(match["action"], match["value"] or "", int(match["hit"]))
    return faults


def _sound(action: str, value: str) -> bool:
    """Return whether the value is valid for the action."""
    if action == "kill":
        return not value
    if action == "sleep":
        return re.fullmatch(r"[0-9]+(\.[0-9]+)?", value) is not None
    return value in _ERRORS or value in _CODES


class _Active:
    """A folder's plan, read again whenever it is replaced."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._version: tuple[int, int] | None = None
        self._faults: dict[str, Fault] = {}

    def refresh(self) -> None:
        path = self._folder / PLAN
        try:
            found = path.stat()
            version = (found.st_ino, found.st_mtime_ns)
            if version != self._version:
                self._faults, self._version = read_plan(path.read_text(encoding="ascii")), version
        except FileNotFoundError:
            self._faults, self._version = {}, None

    def passed(self, name: str) -> None:
        self.refresh()
        number, fault = self._count(name), self._faults.get(name)
        if fault is not None and fault.hit == number:
            fault.strike()

    def _count(self, name: str) -> int:
        """Return the number of this passage: the position of the byte that was added for it."""
        handle = os.open(self._folder / name, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC, 0o600)
        try:
            os.write(handle, b".")
            return os.lseek(handle, 0, os.SEEK_CUR)
        finally:
            os.close(handle)
