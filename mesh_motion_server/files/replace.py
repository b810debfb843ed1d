"""Write files that appear complete or not at all, and check before the work that they can be written."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from mesh_motion_protocol.errors import InvalidInput, ResourceExhausted


def require_file_place(path: Path) -> None:
    """Check before any work that a file can be written at this path.

    Raises InvalidInput if its folder is missing, or it is a folder itself. Raises ResourceExhausted if the folder is
    not writable.
    """
    folder = path.resolve().parent  # a link is kept; its target is replaced
    if path.is_dir():
        raise InvalidInput(f"{path}: this is a folder, but a file is to be written", hint="name a file in it")
    if not folder.is_dir():
        raise InvalidInput(f"{path}: there is no folder {folder}", hint=f"mkdir -p '{folder}', or give another folder")
    _require_writable(path, folder)


def require_folder_place(path: Path) -> None:
    """The same check for a folder; missing folders will be created, including parents."""
    place = path.resolve()
    while not os.path.lexists(place):
        place = place.parent
    if not place.is_dir():
        raise InvalidInput(f"{path}: {place} is not a folder", hint="name another one")
    _require_writable(path, place)


def _require_writable(path: Path, folder: Path) -> None:
    if not os.access(folder, os.W_OK | os.X_OK):
        raise ResourceExhausted(
            f"{path}: {folder} cannot be written by this user",
            hint="give another folder, or check its rights (ls -ld) and the mount",
        )


@contextmanager
def replacing(path: Path) -> Iterator[BinaryIO]:
    """Open a temporary file next to ``path``; rename it when the block ends without an error, else remove it."""
    with replaced_by_name(path) as partial, partial.open("wb") as file:
        yield file


@contextmanager
def replaced_by_name(path: Path) -> Iterator[Path]:
    """The same for libraries that open files themselves: yields the temporary name. A link is kept."""
    path = path.resolve()
    partial = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        yield partial
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
