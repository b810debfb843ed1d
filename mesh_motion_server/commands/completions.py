"""Completions of option values for the shell; typer completes commands and options themselves.

Each function takes the typed text and returns the possible values; without a value the shell offers files. The
functions import no large modules, because they run each time Tab is pressed.
"""

from __future__ import annotations

import re
from pathlib import Path

#: Default state folder of ``serve``.
_STATE = Path("~/.local/state/mesh-motion")
_SESSION = re.compile(r"[0-9a-f]{32}")


def beginning_with(incomplete: str, *words: str) -> list[str]:
    """Return the words that start with the typed text."""
    return [word for word in words if word.startswith(incomplete)]


def log_levels(incomplete: str) -> list[str]:
    """Complete ``serve --log-level``."""
    return beginning_with(incomplete, "debug", "info", "warning", "error")


def roles(incomplete: str) -> list[str]:
    """Complete ``keys allow --role``."""
    return beginning_with(incomplete, "owner", "monitor", "admin")


def session_folders(incomplete: str) -> list[str]:
    """Return the stored sessions of the default state folder, and that folder."""
    state = _STATE.expanduser()
    if not state.is_dir():
        return []
    stored = sorted(str(path) for path in state.glob("sessions/*") if _SESSION.fullmatch(path.name))
    return beginning_with(incomplete, str(state), *stored)
