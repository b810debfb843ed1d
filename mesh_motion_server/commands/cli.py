"""The entry point ``mesh-motion``: what can go wrong becomes one line on standard error and an exit status.

======  =============================================================================================
status  meaning
======  =============================================================================================
0       done; warnings, if any, were printed
1       not met: a demand of SPEC.md (`conform`), the same states again (`play --from-journal`)
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
import os
import sys
import traceback
from enum import IntEnum
from io import TextIOWrapper
from typing import Any, NoReturn

from mesh_motion_server.extras import not_installed
from mesh_motion_server.watch.terminal.text import plain

__all__ = ["ExitStatus", "complain", "main", "say", "say_json", "status_of"]


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
    """Print one line on standard error."""
    sys.stderr.write(f"mesh-motion: {plain(' '.join(message.split()))}\n")


def say(text: object) -> None:
    """Print lines on standard output; characters that could control a terminal are shown as ``�``."""
    sys.stdout.write("".join(f"{plain(line)}\n" for line in str(text).split("\n")))


def say_json(values: dict[str, Any]) -> None:
    """Print values for a program on standard output; with escapes on a terminal, as a label may have any character."""
    sys.stdout.write(json.dumps(values, indent=2, ensure_ascii=sys.stdout.isatty()) + "\n")


def main() -> NoReturn:
    """Run the command line and exit."""
    _open_standard_streams()
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")  # otherwise pydantic searches every installed package
    if isinstance(sys.stdout, TextIOWrapper):  # a label may have characters outside the encoding: they are shown as "?"
        sys.stdout.reconfigure(errors="replace")
    try:
        from mesh_motion_server.commands.app import app  # noqa: PLC0415  (its packages may be missing: the client's do)

        app()
    except ModuleNotFoundError as error:
        line = not_installed(error)
        if line is None:
            _report_defect(error)
        complain(line)
        sys.exit(ExitStatus.UNAVAILABLE)
    except BrokenPipeError:  # the reader of the output has ended, as in `| head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(ExitStatus.DONE)
    except Exception as error:
        _report_defect(error)
    sys.exit(ExitStatus.DONE)


def _open_standard_streams() -> None:
    """Open the standard streams that are closed, as in daemons: their numbers would go to the next files and sockets,
    here and in children, and the output would go there.
    """
    while (descriptor := os.open(os.devnull, os.O_RDWR)) <= 2:
        os.set_inheritable(descriptor, True)
    os.close(descriptor)
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode, encoding="utf-8"))  # noqa: SIM115 - for the process' life


def _report_defect(error: Exception) -> NoReturn:
    """Print the data for a bug report; exit with status 70."""
    traceback.print_exception(error)
    complain(f"a defect of this program: {type(error).__name__}; please report the lines above")
    sys.exit(ExitStatus.DEFECT)
