"""The proof that a session was never built, so that its folder may be removed."""

from pathlib import Path

from mesh_motion_server.session.history.boundary import BOUNDARY
from mesh_motion_server.session.history.events import FOLDER
from mesh_motion_server.session.journal.files import MANIFEST, NEXT_MANIFEST, SLOTS
from mesh_motion_server.session.journal.filesystem import FileSystem, reading

UNBUILT = "unbuilt"
"""An empty file in a session's folder from OPEN until BUILD is durable."""

_RECORD = 64
"""Bytes of a slot; some are not zero after a record was written, because slots are blank until the first commit."""


def never_built(files: FileSystem, folder: Path) -> bool:
    """Whether a session's folder is marked as unbuilt and has no data of BUILD or of a commit, or has only a lock.

    The mark alone is no proof: an older backup may restore it next to newer files. ``manifest.new`` is made after the
    manifest; slots are blank, and the boundary is not in the history, until the first commit. Raises OSError if the
    folder cannot be read, so that the answer is unknown.
    """
    if any(files.exists(folder / name) for name in (MANIFEST, NEXT_MANIFEST)):
        return False
    if files.exists(folder / UNBUILT):
        return not (_has_history(files, folder) or any(_has_record(files, folder / name) for name in SLOTS))
    return set(files.names(folder)) <= {"lock"}


def _has_history(files: FileSystem, folder: Path) -> bool:
    return files.exists(folder / FOLDER) and any(name.startswith(BOUNDARY) for name in files.names(folder / FOLDER))


def _has_record(files: FileSystem, slot: Path) -> bool:
    if not files.exists(slot):
        return False
    with reading(files, slot) as handle:
        return any(files.read(handle, 0, _RECORD))


def mark_built(files: FileSystem, folder: Path) -> None:
    """Remove the mark; durable on return. Raises OSError if the disk fails."""
    if files.exists(folder / UNBUILT):
        files.remove(folder / UNBUILT)
        files.sync_folder(folder)
