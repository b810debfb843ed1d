"""Files that are only appended to, the next one begun when one is full.

They belong to the one process that holds the session; readers come and go. The operating system's calls are made here
and not through the journal's ``FileSystem``: what the journal is proved
with, losses of power and failing disks, is not to meet files that nothing depends on.
"""

from __future__ import annotations

import os
import re
import time
from collections.abc import Callable
from pathlib import Path

from mesh_motion_server.operation.room import disk_room

__all__ = ["Full", "Segments", "Slow", "list_segments", "require_room"]

#: An append that takes longer, and so many seconds more for each byte, is of a disk that holds the session up.
PATIENCE, _PER_BYTE = 1.0, 1 / (32 << 20)
#: In all it may do so for so many seconds, and this share of the time: a pause of the machine now and then, which looks
#: the same from here, costs no history.
ALLOWANCE, _SHARE = 20.0, 0.01
_FLAGS = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC | os.O_NOFOLLOW


class Full(Exception):
    """The bytes granted are used."""


class Slow(Exception):
    """The disk takes what it is given, but again and again not in time."""


def list_segments(folder: Path, kind: str) -> list[Path]:
    """The segments of a kind, oldest first; none where there is no folder."""
    pattern = re.compile(rf"{kind}-[0-9]{{8}}\.(jsonl|bin)")
    try:
        return sorted(path for path in folder.iterdir() if pattern.fullmatch(path.name))
    except OSError:
        return []


def require_room(folder: Path, reserve_bytes: int) -> None:
    """Raise OSError where less of the disk would be left."""
    if disk_room(folder).free < reserve_bytes:
        raise OSError(f"less than {reserve_bytes} bytes of the disk are free")


class Segments:
    """Appends to the newest segment of a kind.

    Parameters
    ----------
    folder : Path
        Exists.
    kind : {"events", "boundary"}
    segment_bytes : int
        A segment of so many bytes is full.
    total_bytes : int
        Of all segments together.
    reserve_bytes : int
        No segment is begun where less of the disk would be free.
    mend : callable
        Descriptor of the segment that is gone on with: ends or cuts what a crash has left torn.
    keep : callable
        Path of a segment that goes: what is kept of it, once, in a segment of the same name.
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
        """Write ``data``, whole unless the disk fails; where all bytes are used the oldest segments go, or nothing.

        Parameters
        ----------
        forget : bool
            Whether the oldest segments may be removed.

        Raises
        ------
        Full
            If they may not, and there is no room.
        Slow
            If it took longer than :data:`PATIENCE`, and such waits exceed :data:`ALLOWANCE`; it is written anyway.
        OSError
            If the disk does not take it.
        """
        begin = time.monotonic()
        self._append(data, forget=forget)
        now = time.monotonic()
        if now - begin > PATIENCE + len(data) * _PER_BYTE:
            self._waited += now - begin
            if self._waited > ALLOWANCE + _SHARE * (now - self._since):
                raise Slow(f"the disk has let steps wait for {self._waited:.1f} s, now {now - begin:.1f} s")

    def close(self) -> None:
        """Give the file back; idempotent."""
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
        _write(self._handle, data, self._grow)

    @property
    def _newest(self) -> Path:
        return next(reversed(self._sizes))

    def _grow(self, more: int) -> None:
        self._sizes[self._newest] += more
        self._used += more

    def _begin(self) -> None:
        """The next segment."""
        require_room(self._folder, self._reserve)
        number = 1 + int(self._newest.stem[-8:]) if self._sizes else 0
        self.close()
        path = self._folder / f"{self._kind}-{number:08}.{self._suffix}"
        self._open(path, _FLAGS)
        self._sizes[path] = 0

    def _open(self, path: Path, flags: int) -> None:
        self._handle = os.open(path, flags, 0o600)

    def _remove_oldest(self, more: int) -> None:
        """Make room for ``more`` bytes; the newest segment stays, and what is kept goes last."""
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
        """Another segment of the same name, in one step: whoever reads has the old one or the new one."""
        partial = self._folder / "kept.part"
        partial.unlink(missing_ok=True)
        handle = os.open(partial, _FLAGS, 0o600)
        try:
            _write(handle, data)
        finally:
            os.close(handle)
        partial.replace(path)


def _write(handle: int, data: bytes, written: Callable[[int], None] = lambda _: None) -> None:
    """Write all of it; ``written`` gets the number of bytes each time."""
    view = memoryview(data)
    while view:
        count = os.write(handle, view)
        written(count)
        view = view[count:]
