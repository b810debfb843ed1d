"""The entry point ``mesh-motion``: each failure becomes one line on standard error and an exit status."""

from __future__ import annotations

import errno
import os
import sys
import traceback
from io import TextIOWrapper
from typing import NoReturn

from mesh_motion_server.commands.outcome import ExitStatus, complain
from mesh_motion_server.extras import not_installed

#: A disk takes no more of the output, which is redirected to a file.
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)


def main() -> NoReturn:
    """Run the command line and exit."""
    _open_standard_streams()
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")  # otherwise pydantic searches every installed package
    if isinstance(sys.stdout, TextIOWrapper):  # a label may have characters outside the encoding: they are shown as "?"
        sys.stdout.reconfigure(errors="replace")
    try:
        from mesh_motion_server.commands.app import app  # noqa: PLC0415  (its packages may be missing: the client's do)

        try:
            app()
        finally:
            sys.stdout.flush()
    except ModuleNotFoundError as error:
        line = not_installed(error)
        if line is None:
            _report_defect(error)
        complain(line)
        sys.exit(ExitStatus.UNAVAILABLE)
    except BrokenPipeError:  # the reader of the output has ended, as in `| head`
        _discard_output()
        sys.exit(ExitStatus.DONE)
    except OSError as error:
        if error.errno not in _NO_ROOM or error.filename is not None:
            _report_defect(error)
        _discard_output()
        complain(f"the output cannot be written: {error.strerror}")
        sys.exit(ExitStatus.FAILED)
    except Exception as error:
        _report_defect(error)
    sys.exit(ExitStatus.DONE)


def _open_standard_streams() -> None:
    """Open the standard streams that are closed, as in daemons.

    Otherwise the next files and sockets get their numbers, here and in child processes, and output is written to them.
    """
    while (descriptor := os.open(os.devnull, os.O_RDWR)) <= 2:
        os.set_inheritable(descriptor, True)
    os.close(descriptor)
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode, encoding="utf-8"))  # noqa: SIM115 - for the process' life


def _discard_output() -> None:
    """Write nothing more to standard output, not even at the end of the process."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _report_defect(error: Exception) -> NoReturn:
    """Print the data for a bug report; exit with status 70."""
    traceback.print_exception(error)
    complain(f"a defect of this program: {type(error).__name__}; please report the lines above")
    sys.exit(ExitStatus.DEFECT)
