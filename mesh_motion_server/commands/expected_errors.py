"""Expected errors of a command, which are no defects: one line on standard error and an exit status."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import typer
from mesh_motion_protocol.errors import MeshMotionError

from mesh_motion_server.commands.outcome import ExitStatus, complain, status_of


@contextmanager
def expected_errors() -> Iterator[None]:
    """Turn expected errors into one line and an exit status."""
    try:
        yield
    except MeshMotionError as error:
        _print(str(error), error)
        raise typer.Exit(status_of(error.code)) from None
    except KeyboardInterrupt as interrupt:
        _print("interrupted", interrupt)
        raise typer.Exit(ExitStatus.INTERRUPTED) from None


def _print(line: str, error: BaseException) -> None:
    """Print the line and the notes of the error."""
    for text in (line, *getattr(error, "__notes__", ())):
        complain(text)
