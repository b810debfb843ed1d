"""Expected errors of a command, which are no defects: one line on standard error and an exit status."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager

import typer
from mesh_motion_protocol.errors import MeshMotionError

from mesh_motion_server.commands.cli import ExitStatus, complain, status_of

__all__ = ["expected_errors"]


@contextmanager
def expected_errors() -> Iterator[None]:
    """Turn expected errors into one line and an exit status."""
    try:
        yield
    except _kinds() as error:
        _tell(str(error), error)
        raise typer.Exit(status_of(getattr(error, "code", ""))) from None
    except KeyboardInterrupt as interrupt:
        _tell("interrupted", interrupt)
        raise typer.Exit(ExitStatus.INTERRUPTED) from None


def _tell(line: str, error: BaseException) -> None:
    """Print the line and the notes of the error."""
    for text in (line, *getattr(error, "__notes__", ())):
        complain(text)


def _kinds() -> tuple[type[Exception], ...]:
    """Return the server's errors, and the client's if it is imported: do not import it just for this."""
    client = sys.modules.get("mesh_motion_protocol.errors")
    return (MeshMotionError, *([client.MeshMotionError] if client else []))
