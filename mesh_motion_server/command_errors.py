"""What can go wrong in a command and is no defect: one line on standard error and an exit status."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import typer
from mesh_motion_client import MeshMotionError as ClientError

from mesh_motion_server.cli import ExitStatus, complain, status_of
from mesh_motion_server.errors import MeshMotionError

__all__ = ["expected_errors"]


@contextmanager
def expected_errors() -> Iterator[None]:
    """Turn expected errors into one line and an exit status."""
    try:
        yield
    except (MeshMotionError, ClientError) as error:
        complain(str(error))
        raise typer.Exit(status_of(error.code)) from None
    except KeyboardInterrupt:
        complain("interrupted")
        raise typer.Exit(ExitStatus.INTERRUPTED) from None
