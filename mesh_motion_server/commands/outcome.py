"""Output of a command, and its exit status.

======  =============================================================================================
status  meaning
======  =============================================================================================
0       done; warnings, if any, were printed
1       a requirement of SPEC.md is not met (`conform`), or the states differ (`play --from-journal`)
2       usage, or an invalid case, mesh, table or setting
3       refused: no acceptable mesh was found for a motion
4       the session or the server's limits or storage do not allow it, or results cannot be written
69      no answer: no server at the endpoint, the endpoint is taken, or a package is not installed
70      a defect of this program
78      the server's settings are wrong or unsafe
130     interrupted
======  =============================================================================================
"""

from __future__ import annotations

import json
import sys
from enum import IntEnum
from typing import TYPE_CHECKING, Any

from mesh_motion_server.watch.terminal.text import plain

if TYPE_CHECKING:
    from rich.console import RenderableType

#: Largest number of characters of a message.
_MOST_CHARACTERS = 2000


class ExitStatus(IntEnum):
    """Exit statuses; statuses from 64 on have the meaning of sysexits.h."""

    DONE = 0
    UNMET = 1
    INVALID = 2
    REFUSED = 3
    FAILED = 4
    UNAVAILABLE = 69
    DEFECT = 70
    CONFIGURATION = 78
    INTERRUPTED = 130


#: Exit status by error code; the longest matching prefix counts. Any other code is FAILED.
_BY_CODE = (
    ("INVALID_ARGUMENT", ExitStatus.INVALID),
    ("FAILED_PRECONDITION.QUALITY", ExitStatus.REFUSED),
    ("UNAVAILABLE", ExitStatus.UNAVAILABLE),
    ("DEADLINE_EXCEEDED", ExitStatus.UNAVAILABLE),
    ("INTERNAL", ExitStatus.DEFECT),
    ("UNIMPLEMENTED.", ExitStatus.FAILED),
    ("UNIMPLEMENTED", ExitStatus.UNAVAILABLE),
)


def status_of(code: str) -> ExitStatus:
    """Exit status for an error code of the protocol."""
    return next((status for beginning, status in _BY_CODE if code.startswith(beginning)), ExitStatus.FAILED)


def complain(message: str) -> None:
    """Print one line on standard error; of a very long one, such as a value of a file, its beginning and its end."""
    line = plain(" ".join(message.split()))
    if len(line) > _MOST_CHARACTERS:
        line = f"{line[: _MOST_CHARACTERS // 2]} … ({len(line)} characters) … {line[-_MOST_CHARACTERS // 4 :]}"
    sys.stderr.write(f"mesh-motion: {line}\n")


def say(text: object) -> None:
    """Print lines on standard output; characters that could control a terminal are shown as ``�``."""
    sys.stdout.write("".join(f"{plain(line)}\n" for line in str(text).split("\n")))


def say_json(values: dict[str, Any]) -> None:
    """Print values for a program on standard output; with escapes on a terminal, as a label may have any character."""
    sys.stdout.write(json.dumps(values, indent=2, ensure_ascii=sys.stdout.isatty()) + "\n")


def show(table: RenderableType) -> None:
    """Print a table on standard output."""
    from mesh_motion_server.watch.terminal.console import console  # noqa: PLC0415 - Rich takes time to import

    console(soft_wrap=True).print(table)
