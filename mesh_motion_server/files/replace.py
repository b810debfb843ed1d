"""Files that appear complete or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

__all__ = ["replaced_by_name", "replacing"]


@contextmanager
def replacing(path: Path) -> Iterator[BinaryIO]:
    """Open a neighbour of ``path`` for writing; it takes the name when the block ends well, and vanishes otherwise."""
    with replaced_by_name(path) as partial, partial.open("wb") as file:
        yield file


@contextmanager
def replaced_by_name(path: Path) -> Iterator[Path]:
    """The same for libraries that open files themselves: the neighbour's name. A link stays one to the new file."""
    path = path.resolve()
    partial = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        yield partial
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
