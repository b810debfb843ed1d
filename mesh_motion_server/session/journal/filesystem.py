"""The operations of a file system that the durable state needs; few enough to be replaced in tests.

The journal and the store do their input and output through :class:`FileSystem` only. Tests replace it by a model that
loses power between any two operations, or by one whose operations fail: so the tested code is the real code.
"""

import errno
import fcntl
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Protocol, TypeVar

from mesh_motion_protocol.errors import DataLoss, MeshMotionError
from mesh_motion_protocol.lacks import way_out_of

from mesh_motion_server.absence import is_missing
from mesh_motion_server.operation.tally import TALLY

Buffer = bytes | memoryview
_Error = TypeVar("_Error", bound=MeshMotionError)
#: Flags for opening: a link is not followed, and opening a pipe does not wait.
_FLAGS = os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK


class FileSystem(Protocol):
    """Files by handle, at offsets. Every method may raise OSError."""

    def make_folder(self, path: Path) -> None:
        """Make a folder that only its owner may enter (0700), with its parents; existing folders are kept."""

    def create(self, path: Path, size: int) -> int:
        """Create or empty a file, and reserve ``size`` bytes that read as zeros; return its handle."""
        ...

    def open(self, path: Path, *, writable: bool = True) -> int:
        """Return the handle of an existing regular file; EISDIR if it is anything else, ELOOP for a link."""
        ...

    def size(self, handle: int) -> int:
        """Length in bytes."""
        ...

    def read(self, handle: int, offset: int, size: int) -> bytes:
        """Read up to ``size`` bytes from ``offset``; fewer only at the end of the file."""
        ...

    def write(self, handle: int, offset: int, data: Buffer) -> int:
        """Write; return the number of written bytes, which may be fewer than given."""
        ...

    def sync(self, handle: int) -> None:
        """Put the file's content on the disk (fdatasync)."""

    def close(self, handle: int) -> None:
        """Close the handle."""

    def sync_folder(self, path: Path) -> None:
        """Put the folder's entries on the disk."""

    def rename(self, source: Path, target: Path) -> None:
        """Replace ``target`` atomically."""

    def remove(self, path: Path) -> None:
        """Remove a file if it exists."""

    def exists(self, path: Path) -> bool:
        """Whether there is an entry with this name; only ENOENT means no, every other error is raised."""
        ...

    def names(self, path: Path) -> list[str]:
        """The names in a folder."""
        ...

    def lock(self, path: Path) -> int:
        """Return the handle of a lock file held only by this process; BlockingIOError if another process holds it."""
        ...


def write_all(files: FileSystem, handle: int, offset: int, data: Buffer) -> int:
    """Write all of ``data`` at ``offset`` in any number of chunks; return the offset after it."""
    view = memoryview(data).cast("B")
    while view:
        written = files.write(handle, offset, view)
        if written <= 0:
            raise OSError(errno.EIO, "a write took no byte")
        offset, view = offset + written, view[written:]
    return offset


def read_whole(files: FileSystem, path: Path, most: int) -> bytes:
    """All bytes of a file; OSError if it has more than ``most``, as a damaged file system may say."""
    with reading(files, path) as handle:
        return files.read(handle, 0, bounded_size(files, handle, most))


def bounded_size(files: FileSystem, handle: int, most: int) -> int:
    """Length in bytes; OSError if it is more than ``most``."""
    size = files.size(handle)
    if size > most:
        raise OSError(errno.EFBIG, f"it has {size} bytes, expected at most {most}")
    return size


@contextmanager
def reading(files: FileSystem, path: Path) -> Iterator[int]:
    """Yield the handle of an existing file; it is closed at the end of the block."""
    handle = files.open(path, writable=False)
    try:
        yield handle
    finally:
        files.close(handle)


def make_durable_folder(files: FileSystem, path: Path) -> None:
    """Make the folder and its missing parents; each is synced in the folder that contains it."""
    missing = [folder for folder in (path, *path.parents) if not files.exists(folder)]
    files.make_folder(path)
    for folder in missing:
        files.sync_folder(folder.parent)


def write_file(files: FileSystem, path: Path, data: bytes, size: int = 0) -> None:
    """Write a new file that starts with ``data``, has at least ``size`` bytes, and is synced."""
    write_durably(files, files.create(path, size), data)


def write_durably(files: FileSystem, handle: int, data: bytes) -> None:
    """Write ``data`` at the beginning of an open file, sync and close it."""
    try:
        write_all(files, handle, 0, data)
        files.sync(handle)
    finally:
        files.close(handle)


#: The path has no file, or a folder.
_REPLACED = (errno.ENOENT, errno.EISDIR)


def unreadable(what: str, error: OSError) -> DataLoss:
    """Make the error for a failed read: nothing is known to be lost, unless the file is missing or replaced."""
    if error.errno in _REPLACED:
        return DataLoss(f"{what} cannot be read: {_said(error)}")
    return disk_failure(DataLoss, f"{what} cannot be read", error)


def _said(error: OSError) -> str:
    """The system's message, after the file's name if the error has one."""
    name = f"{os.path.basename(os.fsdecode(error.filename))}: " if error.filename else ""
    return f"{name}{error.strerror or error}"


def disk_failure(
    kind: type[_Error],
    doing: str,
    error: OSError,
    consequence: str = "",
    hint: str = "check the disk that holds the state folder, then try again",
) -> _Error:
    """Make the error for a failed disk operation: the file, the system's message and error name, the consequence."""
    name = errno.errorcode.get(error.errno or 0, "unknown")
    return kind(
        f"{doing}: {_said(error)} ({name}){consequence}",
        code="RESOURCE_EXHAUSTED.DISK",
        hint=way_out_of(error, hint),
        details={"errno": name},
    )


class PosixFileSystem:
    """The operating system's files."""

    #: Linux transfers at most 2 GiB - 4 KiB in one call.
    _LARGEST_CALL = 1 << 30

    def make_folder(self, path: Path) -> None:
        path.mkdir(mode=0o700, parents=True, exist_ok=True)

    def create(self, path: Path, size: int) -> int:
        handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_TRUNC | _FLAGS, 0o600)
        try:
            if size:
                os.posix_fallocate(handle, 0, size)
        except OSError:
            os.close(handle)
            raise
        return handle

    def open(self, path: Path, *, writable: bool = True) -> int:
        try:
            handle = os.open(path, (os.O_RDWR if writable else os.O_RDONLY) | _FLAGS)
        except OSError as error:
            if error.errno != errno.ELOOP:
                raise
            raise OSError(errno.ELOOP, "it is a link, expected the file itself", str(path)) from error
        if not stat.S_ISREG(os.fstat(handle).st_mode):
            os.close(handle)
            raise OSError(errno.EISDIR, "it is not a file, but a folder, a pipe or a device", str(path))
        return handle

    def size(self, handle: int) -> int:
        return os.fstat(handle).st_size

    def read(self, handle: int, offset: int, size: int) -> bytes:
        chunks = []
        while size > 0:
            chunk = os.pread(handle, min(size, self._LARGEST_CALL), offset)
            if not chunk:
                break
            chunks.append(chunk)
            offset, size = offset + len(chunk), size - len(chunk)
        return chunks[0] if len(chunks) == 1 else b"".join(chunks)

    def write(self, handle: int, offset: int, data: Buffer) -> int:
        written = os.pwrite(handle, memoryview(data)[: self._LARGEST_CALL], offset)
        TALLY.count("journal_written_bytes", written)
        return written

    def sync(self, handle: int) -> None:
        with TALLY.timed("fsync_seconds"):
            os.fdatasync(handle)

    def close(self, handle: int) -> None:
        os.close(handle)

    def sync_folder(self, path: Path) -> None:
        handle = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)

    def rename(self, source: Path, target: Path) -> None:
        source.replace(target)

    def remove(self, path: Path) -> None:
        path.unlink(missing_ok=True)

    def exists(self, path: Path) -> bool:
        return not is_missing(path)

    def names(self, path: Path) -> list[str]:
        return os.listdir(path)

    def lock(self, path: Path) -> int:
        handle = os.open(path, os.O_RDWR | os.O_CREAT | _FLAGS, 0o600)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            os.close(handle)
            raise
        return handle
