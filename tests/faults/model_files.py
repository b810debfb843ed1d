"""File systems for tests: a model in memory that can lose power, and a wrapper whose operations fail.

The model is harsher than ext4: after a power loss the disk has any subset of the 512-byte sectors written since a
file's last sync, and any prefix of the changes to a folder since its last sync. A failed sync drops the unwritten data,
while reads still see it, as on Linux.
"""

from __future__ import annotations

import errno
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import Any

SECTOR = 512


class PowerLoss(Exception):
    """The machine is off; nothing more happens."""


@dataclass
class _File:
    """The data that reads see, the data on the disk, and the writes since the last sync (None: a change of the file's
    size).
    """

    cache: bytearray = field(default_factory=bytearray)
    disk: bytearray = field(default_factory=bytearray)
    pending: list[tuple[int, bytes]] = field(default_factory=list)

    def settle(self) -> None:
        """Write pending data to the disk; data that a failed sync has dropped stays lost, though reads see it."""
        self.disk = self.disk[: len(self.cache)].ljust(len(self.cache), b"\0")
        for offset, data in self.pending:
            self.disk[offset : offset + len(data)] = data
        self.pending = []

    def copy(self) -> _File:
        return _File(bytearray(self.cache), bytearray(self.disk), list(self.pending))


class ModelFiles:
    """Files in memory.

    ``operations``: every requested change since :meth:`arm`; ``crash_at`` (int or None): number of operations before
    power is lost; ``before``: called before each operation, with it.
    """

    def __init__(self) -> None:
        self.entries: dict[Path, _File] = {}
        self.durable: dict[Path, _File] = {}
        self.changes: list[tuple[Path, _File | None]] = []
        self.folders: set[Path] = set()
        self.handles: dict[int, Any] = {}
        self.operations: list[str] = []
        self.crash_at: int | None = None
        self.before: Callable[[str], None] | None = None
        self._next_handle = 1

    # --- the proof's side ------------------------------------------------------------------------------------------

    def arm(self, crash_at: int | None) -> None:
        self.operations, self.crash_at = [], crash_at

    def copy(self) -> ModelFiles:
        """The same files and pending data, with no open file: as another machine would find them after a power loss."""
        other, made = ModelFiles(), dict[int, _File]()

        def of(file: _File) -> _File:
            if id(file) not in made:
                made[id(file)] = file.copy()
            return made[id(file)]

        other.entries = {path: of(file) for path, file in self.entries.items()}
        other.durable = {path: of(file) for path, file in self.durable.items()}
        other.changes = [(path, None if file is None else of(file)) for path, file in self.changes]
        other.folders = set(self.folders)
        return other

    def restore(self, contents: dict[Path, bytes]) -> None:
        self.entries = {path: _File(bytearray(data), bytearray(data)) for path, data in contents.items()}
        self.durable = dict(self.entries)

    def lose_power(self, random: Random) -> None:
        """Change to one of the possible disks after a restart."""
        kept = random.randrange(len(self.changes) + 1)
        for path, file in self.changes[:kept]:
            self._change(self.durable, path, file)
        for file in {id(f): f for f in [*self.durable.values(), *self.entries.values()]}.values():
            self._tear(file, random)
        self.entries, self.changes, self.handles, self.crash_at = dict(self.durable), [], {}, None

    @staticmethod
    def _change(entries: dict[Path, _File], path: Path, file: _File | None) -> None:
        if file is None:
            entries.pop(path, None)
        else:
            entries[path] = file

    @staticmethod
    def _tear(file: _File, random: Random) -> None:
        """Any subset of the sectors written since the last sync."""
        if len(file.disk) != len(file.cache):
            length = random.choice((len(file.disk), len(file.cache)))
            file.disk = bytearray(file.disk[:length].ljust(length, b"\0"))
        some = random.choice((0.0, 0.5, 0.9, 1.0))
        for offset, data in file.pending:
            start = 0
            while start < len(data):
                end = min(len(data), start + SECTOR - (offset + start) % SECTOR)
                if random.random() < some:
                    place = slice(offset + start, min(offset + end, len(file.disk)))
                    file.disk[place] = data[start : start + max(0, place.stop - place.start)]
                start = end
        file.cache, file.pending = bytearray(file.disk), []

    def _operation(self, name: str) -> None:
        if self.crash_at is not None and len(self.operations) >= self.crash_at:
            raise PowerLoss(name)
        if self.before is not None:
            self.before(name)
        self.operations.append(name)

    def _enter(self, path: Path, file: _File | None) -> None:
        self._change(self.entries, path, file)
        self.changes.append((path, file))

    def _handle(self, target: Any) -> int:
        self._next_handle += 1
        self.handles[self._next_handle] = target
        return self._next_handle

    # --- the interface ---------------------------------------------------------------------------------------------

    def make_folder(self, path: Path) -> None:
        self._operation(f"make_folder {path.name}")
        self.folders.add(path)

    def create(self, path: Path, size: int) -> int:
        self._operation(f"create {path.name}")
        file = _File(cache=bytearray(size))
        self._enter(path, file)
        return self._handle(file)

    def open(self, path: Path, *, writable: bool = True) -> int:
        if path not in self.entries:
            raise FileNotFoundError(errno.ENOENT, "no such file", str(path))
        return self._handle(self.entries[path])

    def size(self, handle: int) -> int:
        return len(self.handles[handle].cache)

    def read(self, handle: int, offset: int, size: int) -> bytes:
        return bytes(self.handles[handle].cache[offset : offset + size])

    def write(self, handle: int, offset: int, data: Any) -> int:
        file, data = self.handles[handle], bytes(data)
        # cut into two operations, so that power can be lost between them
        data = data[: max(1, len(data) // 2)] if len(data) > SECTOR else data
        self._operation("write")
        file.cache[len(file.cache) :] = bytes(max(0, offset + len(data) - len(file.cache)))
        file.cache[offset : offset + len(data)] = data
        file.pending.append((offset, data))
        return len(data)

    def sync(self, handle: int) -> None:
        self._operation("sync")
        self.handles[handle].settle()

    def fail_sync(self, handle: int) -> None:
        """Data after a failed fsync: reads see it, the disk never will."""
        self.handles[handle].pending = []

    def close(self, handle: int) -> None:
        del self.handles[handle]

    def sync_folder(self, path: Path) -> None:
        self._operation(f"sync_folder {path.name}")
        for changed, file in self.changes:
            self._change(self.durable, changed, file)
        self.changes = []

    def rename(self, source: Path, target: Path) -> None:
        self._operation(f"rename {target.name}")
        if source in self.folders:
            self._rename_folder(source, target)
            return
        file = self.entries[source]
        self._enter(target, file)
        self._change(self.entries, source, None)
        self.changes.append((source, None))

    def _rename_folder(self, source: Path, target: Path) -> None:
        """Make it durable at once, because no test loses power around it."""
        self.folders = {target if folder == source else folder for folder in self.folders}
        for entries in (self.entries, self.durable):
            for path in [p for p in entries if p.parent == source]:
                entries[target / path.name] = entries.pop(path)

    def remove(self, path: Path) -> None:
        self._operation(f"remove {path.name}")
        if path in self.entries:
            self._enter(path, None)

    def exists(self, path: Path) -> bool:
        return path in self.entries or path in self.folders

    def names(self, path: Path) -> list[str]:
        if path not in self.folders:
            raise FileNotFoundError(errno.ENOENT, "no such folder", str(path))
        return [entry.name for entry in (*self.entries, *self.folders) if entry.parent == path]

    def lock(self, path: Path) -> int:
        if any(target == ("lock", path) for target in self.handles.values()):
            raise BlockingIOError(errno.EWOULDBLOCK, "held", str(path))
        return self._handle(("lock", path))


class FailingFiles:
    """Passes everything on, until operation number ``fail_at`` of ``kinds`` fails: once, or for ever."""

    def __init__(self, files: ModelFiles, *, error: int = errno.EIO, for_ever: bool = True) -> None:
        self._files = files
        self._error = error
        self._for_ever = for_ever
        self.fail_at: int | None = None
        self.count = 0
        self.failed = ""

    def __getattr__(self, name: str) -> Any:
        target = getattr(self._files, name)
        if name not in ("make_folder", "create", "write", "sync", "sync_folder", "rename", "remove"):
            return target

        def call(*arguments: Any) -> Any:
            self.count += 1
            due = self.fail_at is not None and self.count >= self.fail_at
            if due and (self._for_ever or not self.failed):
                self.failed = self.failed or name
                if name == "sync":
                    self._files.fail_sync(*arguments)
                raise OSError(self._error, "injected")
            return target(*arguments)

        return call


class ShortFiles:
    def __init__(self, files: Any, most: int) -> None:
        self._files = files
        self._most = most

    def __getattr__(self, name: str) -> Any:
        return getattr(self._files, name)

    def write(self, handle: int, offset: int, data: Any) -> int:
        written: int = self._files.write(handle, offset, memoryview(data)[: self._most])
        return written
