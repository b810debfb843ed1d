"""``mesh-motion play --from-journal``: replays a stored session, and compares the results."""

# ruff: noqa: PLC0415

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import typer
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.commands.outcome import ExitStatus, complain, say
from mesh_motion_server.toml import read_toml

if TYPE_CHECKING:
    from mesh_motion_server.cases.comparison import Comparison


def print_comparison(comparison: Comparison, *, quiet: bool) -> None:
    """Print the table and the notes of the comparison.

    Raises typer.Exit with status 1 if nothing was changed but the states differ.
    """
    from mesh_motion_server.cases.comparison import table_of
    from mesh_motion_server.watch.terminal.console import console

    if not quiet:
        console(soft_wrap=True).print(table_of(comparison))
        for note in comparison.notes:
            say(note)
    if broken := comparison.broken_promise():
        complain(broken)
        raise typer.Exit(ExitStatus.UNMET)


def changes_of(assignments: Sequence[str]) -> dict[str, Any]:
    """Settings by key; values in TOML's form, or words without quotes.

    Raises InvalidInput if there is no ``=``, or no key before it.
    """
    changes: dict[str, Any] = {}
    for text in assignments:
        key, equals, value = (part.strip() for part in text.partition("="))
        if not (key and equals and value):
            raise InvalidInput(f"expected a setting as key=value, got {text!r}", hint="--set support_radius=0.5")
        try:
            changes[key] = read_toml(f"value = {value}")["value"]
        except tomllib.TOMLDecodeError:
            changes[key] = value
    return changes
