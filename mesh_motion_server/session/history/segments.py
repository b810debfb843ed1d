"""Append-only files; when one is full, the next one is started.

They belong to the one process that holds the session; any process may read them. This module calls the operating
system directly, not through the journal's ``FileSystem``: the journal's tests simulate losses of power and failing
disks, and must not include files of no importance.
"""

import os
import re
import stat
import time
from collections.abc import Callable
from pathlib import Path

from mesh_motion_server.operation.room import disk_room

#: Seconds, and seconds per byte: an append that takes longer than both together counts as a delay by the disk.
PATIENCE, _PER_BYTE = 1.0, 1 / (32 << 20)
#: Allowed total of such delays, in seconds and as a share of the time: a short pause of the machine, which cannot be
#: distinguished from a delay, does not end the history.
ALLOWANCE, _SHARE = 20.0, 0.01
_FLAGS = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC | os.O_NOFOLLOW


class Full(Exception):
    """The granted bytes are all used."""


class Slow(Exception):
    """The disk writes the data, but is repeatedly too slow."""


def list_segments(folder: Path, kind: str) -> list[Path]:
    """The segments of a kind, oldest first; empty without a folder.

    Links, folders and pipes with such a name are left out; to open a pipe would take for ever. Raises OSError if the
    disk fails, which must not count as a missing folder.
    """
    pattern = re.compile(rf"{kind}-[0-9]{{8}}\.(jsonl|bin)")
    try:
        with os.scandir(folder) as found:
            names = [entry.name for entry in found if pattern.fullmatch(entry.name) and _is_regular(entry)]
        return [folder / name for name in sorted(names)]
    except FileNotFoundError:
        return []


def _is_regular(entry: os.DirEntry[str]) -> bool:
    """Whether an entry of a folder is a regular file, and was not removed meanwhile."""
    try:
        return stat.S_ISREG(entry.stat(follow_symlinks=False).st_mode)
    except FileNotFoundError:
        return False


def require_room(folder: Path, reserve_bytes: int) -> None:
    """Raise OSError if the disk has less free space than the reserve."""
    if disk_room(folder).free < reserve_bytes:
        raise OSError(f"less than {reserve_bytes} bytes of the disk are free")


class Segments:
    """Appends to the newest segment of a kind.

    Parameters
    ----------
    folder : Path
        Must exist.
    kind : {"events", "boundary"}
    segment_bytes : int
        Size at which a segment is full.
    total_bytes : int
        Limit for all segments together.
    reserve_bytes : int
        No segment is started if the disk has less free space.
    mend : callable
        Gets the descriptor of the continued segment: completes or cuts off an incomplete end after a crash.
    keep : callable
        Gets the path of a segment that is removed; returns the content that is kept, in a segment of the same name.
    """

    def __init__(
        self,
        folder: Path,
        kind: str,
        *,
        segment_bytes: int,
        total_bytes: int,
        reserve_bytes: int,
        mend: Callable[[int], None],
        keep: Callable[[Path], bytes],
    ) -> None:
        self._folder, self._kind = folder, kind
        self._segment_bytes, self._total_bytes, self._reserve = segment_bytes, total_bytes, reserve_bytes
        self._suffix = "jsonl" if kind == "events" else "bin"
        self._sizes = {path: path.stat().st_size for path in list_segments(folder, kind)}
        self._used = sum(self._sizes.values())
        self._handle = -1
        self._keep, self._kept = keep, Path()
        self._since, self._waited = time.monotonic(), 0.0
        if self._sizes:
            self._open(newest := next(reversed(self._sizes)), os.O_RDWR | os.O_APPEND | os.O_CLOEXEC | os.O_NOFOLLOW)
            mend(self._handle)
            self._grow(os.fstat(self._handle).st_size - self._sizes[newest])

    def append(self, data: bytes, *, forget: bool) -> None:
        """Write all of ``data`` unless the disk fails; when all bytes are used, remove the oldest segments or raise.

        Raises Full if they may not be removed, and there is no room. Raises Slow if it took longer than
        :data:`PATIENCE`, and such delays exceed :data:`ALLOWANCE`; the data is written. Raises OSError if the disk
        fails.

        Parameters
        ----------
        forget : bool
            Whether the oldest segments may be removed.
        """
        begin = time.monotonic()
        self._append(data, forget=forget)
        now = time.monotonic()
        if now - begin > PATIENCE + len(data) * _PER_BYTE:
            self._waited += now - begin
            if self._waited > ALLOWANCE + _SHARE * (now - self._since):
                raise Slow(f"steps waited {self._waited:.1f} s for the disk in all, this one {now - begin:.1f} s")

    def close(self) -> None:
        """Close the file; idempotent."""
        if self._handle >= 0:
            os.close(self._handle)
            self._handle = -1

    def _append(self, data: bytes, *, forget: bool) -> None:
        if forget:
            self._remove_oldest(len(data))
        if self._used + len(data) > self._total_bytes:
            raise Full(f"{self._total_bytes} bytes of {self._kind} are used")
        if self._handle < 0 or self._sizes[self._newest] + len(data) > max(self._segment_bytes, len(data)):
            self._begin()
        _write(self._handle, data)
        self._grow(len(data))

    @property
    def _newest(self) -> Path:
        return next(reversed(self._sizes))

    def _grow(self, more: int) -> None:
        self._sizes[self._newest] += more
        self._used += more

    def _begin(self) -> None:
        """Start the next segment."""
        require_room(self._folder, self._reserve)
        number = 1 + int(self._newest.stem[-8:]) if self._sizes else 0
        self.close()
        path = self._folder / f"{self._kind}-{number:08}.{self._suffix}"
        self._open(path, _FLAGS)
        self._sizes[path] = 0

    def _open(self, path: Path, flags: int) -> None:
        self._handle = os.open(path, flags, 0o600)

    def _remove_oldest(self, more: int) -> None:
        """Make room for ``more`` bytes; the newest segment is kept, and the kept content of others is removed last."""
        while self._used + more > self._total_bytes and len(self._sizes) > 1:
            older = list(self._sizes)[:-1]
            oldest = next((path for path in older if path != self._kept), self._kept)
            kept = b"" if self._kept in self._sizes else self._keep(oldest)
            if kept:
                self._replace(oldest, kept)
                self._kept = oldest
            else:
                oldest.unlink(missing_ok=True)
            self._used -= self._sizes[oldest] - len(kept)
            self._sizes[oldest] = len(kept)
            if not kept:
                del self._sizes[oldest]

    def _replace(self, path: Path, data: bytes) -> None:
        """Replace a segment in one step: a reader gets the old one or the new one."""
        partial = self._folder / "kept.part"
        partial.unlink(missing_ok=True)
        handle = os.open(partial, _FLAGS, 0o600)
        try:
            _write(handle, data)
        finally:
            os.close(handle)
        partial.replace(path)


def _write(handle: int, data: bytes) -> None:
    """Write all of ``data``. Bytes of a failed write are counted when the history is opened again."""
    view = memoryview(data)
    while view:
        view = view[os.write(handle, view) :]
