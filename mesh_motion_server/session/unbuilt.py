"""What proves that a session was never built, so that its folder may be removed."""

from pathlib import Path

from mesh_motion_server.session.journal.files import MANIFEST, NEXT_MANIFEST, SLOTS
from mesh_motion_server.session.journal.filesystem import FileSystem
from mesh_motion_server.session.spec import SPEC

__all__ = ["UNBUILT", "mark_built", "never_built"]

UNBUILT = "unbuilt"
"""An empty file in a session's folder from OPEN until BUILD is durable."""

_CONTENT = (SPEC, "mesh.bin", *SLOTS, NEXT_MANIFEST, "history")


def never_built(files: FileSystem, folder: Path) -> bool:
    """Whether a session's folder is marked as unbuilt, or empty but for its lock.

    Raises
    ------
    OSError
        If the folder cannot be read: then nothing is known.
    """
    if files.exists(folder / MANIFEST):
        return False
    if files.exists(folder / UNBUILT):
        return True
    if any(files.exists(folder / name) for name in _CONTENT):
        return False
    files.sync_folder(folder)  # raises for what is no folder, such as a dangling link, which looks empty too
    return True


def mark_built(files: FileSystem, folder: Path) -> None:
    """Take the mark away; durable on return.

    Raises
    ------
    OSError
        If the disk fails.
    """
    if files.exists(folder / UNBUILT):
        files.remove(folder / UNBUILT)
        files.sync_folder(folder)
