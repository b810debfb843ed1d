"""The file that becomes the next manifest: its space is reserved in advance, and never freed in between.

``manifest.new`` is in the session's folder with the size of a manifest, all zeros. A new manifest is written into this
file, which is then renamed: emptying it first would free its space, and another program could fill the disk.
"""

from contextlib import suppress
from pathlib import Path

from mesh_motion_server.failpoints import failpoint
from mesh_motion_server.session.journal.files import FIRST_MANIFEST, KEPT_COMMITS, MANIFEST, NEXT_MANIFEST
from mesh_motion_server.session.journal.filesystem import FileSystem, write_durably, write_file
from mesh_motion_server.session.journal.ledger import Foundation

#: Bytes read at a time when a file is scanned.
_PART = 1 << 20
#: Smallest manifest: some 250 commits of one partition.
_LEAST_CAPACITY = 1 << 20
#: A manifest holds at least this many records of the largest size and its checkpoint.
_LEAST_RECORDS = 16


def manifest_capacity(foundation: Foundation) -> int:
    """Bytes for a manifest's records: a checkpoint may have all logged commits, and as many may be logged after it."""
    return max(_LEAST_CAPACITY, (KEPT_COMMITS + _LEAST_RECORDS) * foundation.record_area) + 2 * foundation.log_bytes


def create_manifest(folder: Path, files: FileSystem, packed: bytes, size: int) -> None:
    """Make the first manifest of a session, which starts with this record; durable under its name.

    Later manifests are written under a different name, ``manifest.new``, which proves that there was a manifest.
    """
    write_file(files, folder / FIRST_MANIFEST, packed, size)
    _name(folder, files, FIRST_MANIFEST)


def replace_manifest(folder: Path, files: FileSystem, packed: bytes, size: int) -> None:
    """Make a manifest that starts with this record, in the reserved space; durable under its name."""
    handle = _open_reserve(folder / NEXT_MANIFEST, files, size)
    if handle is None:
        handle = files.create(folder / NEXT_MANIFEST, size)
    write_durably(files, handle, packed)
    _name(folder, files)


def reserve(folder: Path, files: FileSystem, size: int) -> None:
    """Reserve the space of the next manifest. Its loss loses no data, so it is not synced.

    An existing file is kept if nothing was written into it. Otherwise its name is removed first: after a crash during a
    renaming it may be the manifest itself, under both names.
    """
    path = folder / NEXT_MANIFEST
    handle = _open_reserve(path, files, size)
    if handle is None or not _is_blank(files, handle, size):
        if handle is not None:
            files.close(handle)
        files.remove(path)
        handle = files.create(path, size)
    files.close(handle)


def _open_reserve(path: Path, files: FileSystem, size: int) -> int | None:
    """Handle of the file with the reserved space; None if there is none of this size."""
    with suppress(FileNotFoundError):
        handle = files.open(path)
        if files.size(handle) == size:
            return handle
        files.close(handle)
    return None


def _is_blank(files: FileSystem, handle: int, size: int) -> bool:
    return not any(any(files.read(handle, offset, _PART)) for offset in range(0, size, _PART))


def _name(folder: Path, files: FileSystem, written: str = NEXT_MANIFEST) -> None:
    """Give the written file the name of the manifest, durably."""
    failpoint("journal.create.unnamed")
    files.rename(folder / written, folder / MANIFEST)
    failpoint("journal.create.renamed")
    files.sync_folder(folder)
