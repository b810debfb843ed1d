"""A small file that only its owner may read; it is written completely or not at all."""

from __future__ import annotations

import os
from pathlib import Path

__all__ = ["write_private"]


def write_private(path: str | os.PathLike[str], text: str) -> None:
    """Replace a file as a whole by one of mode 0600.

    Parameters
    ----------
    path : path
    text : str
        ASCII; a newline is added.

    Raises
    ------
    OSError
    """
    target = Path(path)
    part = target.with_name(target.name + ".part")
    part.unlink(missing_ok=True)  # a file left by an earlier try may have another mode and owner
    with open(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="ascii") as file:
        file.write(text + "\n")
    part.replace(target)
