"""Describes the sessions at rest for lists; reads the disk again only where it has changed.

Every program that watches a server asks for a list every few seconds, but the sessions at rest do not change. So the
content read from a file is cached as long as the file is the same: its inode, size, and times.
"""

import os
import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, NamedTuple, TypeVar

from mesh_motion_server.absence import is_missing
from mesh_motion_server.errors import JournalError, MeshMotionError
from mesh_motion_server.session.journal.files import MANIFEST, SLOTS, read_ledger
from mesh_motion_server.session.journal.filesystem import FileSystem, read_whole, unreadable
from mesh_motion_server.session.journal.mesh_store import MESH, has_its_length
from mesh_motion_server.session.spec import SPEC, StoredSpec, check_digest
from mesh_motion_server.session.state import State

__all__ = ["UNREADABLE", "Listing", "Remembered", "StoredSession"]

UNREADABLE = "UNREADABLE"
"""The state in lists of a session whose files the system does not give: nothing is known to be lost."""

#: Maximum number of cached sessions, the most recently requested ones; some 10 MB.
_MOST = 10_000
#: A file that was changed less than this many seconds ago may change again with the same time stamp: file system
#: clocks tick in milliseconds to seconds.
_SETTLED_SECONDS = 2.5

_HINT = "restore the session's folder from a backup"

Value = TypeVar("Value")
Stamp = tuple[int, int, int, int, int]


@dataclass(frozen=True)
class StoredSession:
    """A session at rest, for lists; holds no secret.

    Attributes
    ----------
    state : str
        READY; FAILED when files are missing or cut, or the journal or the spec does not verify; UNREADABLE when they
        cannot be read. Whether coordinates and mesh verify is for RESUME and inspect: gigabytes are read for that.
    owner : str
        The public key of the user who opened it; empty on a server without keys.
    """

    session: str
    label: str
    dimension: int
    partitions: int
    step: int
    state: str
    owner: str = ""


class _Journal(NamedTuple):
    """What is used of a journal: the last step, the digest of the spec, and where the last state is stored."""

    step: int
    spec: bytes
    slot: str | None
    slot_bytes: int


class Remembered(Generic[Value]):
    """Caches values read from files, as long as the files are the same.

    Parameters
    ----------
    most : int
        Maximum number of files; beyond it the least recently requested ones are dropped.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._known: OrderedDict[Path, tuple[Stamp, Value]] = OrderedDict()

    def get(self, path: Path, read: Callable[[], Value]) -> Value:
        """Return what ``read`` gives for the file or folder, cached if it has not changed."""
        stamp = _stamp(path)
        known = self._known.pop(path, None)
        if known is None or known[0] != stamp:
            known = None if stamp is None else (stamp, read())
        if known is None:
            return read()  # not a file of the operating system: changes cannot be detected
        if _settled(known[0]):
            self._known[path] = known
            if len(self._known) > self._most:
                self._known.popitem(last=False)
        return known[1]


def _stamp(path: Path) -> Stamp | None:
    """The attributes that change when the file changes."""
    try:
        found = os.stat(path)
    except OSError:
        return None
    return found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns, found.st_ctime_ns


def _settled(stamp: Stamp) -> bool:
    """Whether a later change will change the stamp."""
    return time.time() - max(stamp[-2:]) / 1e9 > _SETTLED_SECONDS


class Listing:
    """Describes sessions by their folders."""

    def __init__(self, files: FileSystem) -> None:
        self._files = files
        self._specs: Remembered[tuple[bytes, StoredSpec | JournalError]] = Remembered(_MOST)
        self._journals: Remembered[_Journal] = Remembered(_MOST)
        self._meshes: Remembered[bool] = Remembered(_MOST)

    def spec(self, folder: Path) -> StoredSpec:
        """What OPEN fixed.

        Raises
        ------
        JournalError
            If it cannot be read, or is not the one that the journal has the digest of.
        """

        try:
            digest = self._journal(folder).spec
        except MeshMotionError:  # a damaged journal gives no digest; RESUME refuses it
            digest = None
        return self._checked_spec(folder, digest)

    def _checked_spec(self, folder: Path, digest: bytes | None) -> StoredSpec:
        raw, spec = self._read_spec(folder)
        if digest is not None:
            check_digest(raw, digest)  # before the content: damage is no other version
        if isinstance(spec, JournalError):
            raise spec
        return spec

    def _read_spec(self, folder: Path) -> tuple[bytes, StoredSpec | JournalError]:
        """The file, and what it says or why that cannot be read."""

        def read() -> tuple[bytes, StoredSpec | JournalError]:
            try:
                raw = read_whole(self._files, folder / SPEC)
            except OSError as error:
                raise unreadable("the session's spec", error) from error
            try:
                return raw, StoredSpec.from_bytes(raw)
            except JournalError as error:
                return raw, error

        return self._specs.get(folder / SPEC, read)

    def _journal(self, folder: Path) -> _Journal:
        def read() -> _Journal:
            ledger = read_ledger(folder, self._files)
            foundation, last = ledger.foundation, ledger.snapshot
            slot = None if last is None else SLOTS[last.slot]
            return _Journal(ledger.step, foundation.spec, slot, foundation.record_area + foundation.state_bytes)

        return self._journals.get(folder / MANIFEST, read)

    def owner(self, folder: Path) -> str:
        """The owner of the session; empty if it cannot be read."""
        try:
            _, spec = self._read_spec(folder)
        except MeshMotionError:
            return ""
        return "" if isinstance(spec, JournalError) else spec.owner

    def _require_files(self, folder: Path, journal: _Journal) -> None:
        """Raise if a file that every session has is not there or is cut; the rest is for RESUME and inspect."""
        mesh = folder / MESH
        for name in (MESH, *SLOTS):
            try:
                if is_missing(folder / name):
                    raise JournalError(f"{name} is missing", hint=_HINT)
                if name == MESH:
                    whole = self._meshes.get(mesh, lambda: has_its_length(mesh, self._files))
                else:
                    whole = name != journal.slot or os.stat(folder / name).st_size >= journal.slot_bytes
            except OSError as error:
                raise unreadable(name, error) from error
            if not whole:
                raise JournalError(f"{name} does not have its length", hint=_HINT)

    def describe(self, folder: Path) -> StoredSession:
        """Describe a session at rest; of its files only heads and the manifest's chain are read, and only once."""
        owner = self.owner(folder)
        try:
            journal = self._journal(folder)
            spec = self._checked_spec(folder, journal.spec)
            self._require_files(folder, journal)
        except MeshMotionError as error:
            state = UNREADABLE if error.code == "RESOURCE_EXHAUSTED.DISK" else State.FAILED
            return StoredSession(folder.name, "", 0, 0, 0, state, owner)
        return StoredSession(folder.name, spec.label, spec.dimension, spec.partitions, journal.step, State.READY, owner)
