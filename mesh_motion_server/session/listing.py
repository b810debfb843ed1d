"""Describes the sessions at rest for lists; reads the disk again only after a change.

Every program that watches a server asks for a list every few seconds, but the sessions at rest do not change. So the
content read from a file is cached as long as the file is the same: its inode, size, and times.
"""

import os
import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Generic, NamedTuple, TypeVar

from mesh_motion_protocol.errors import DataLoss, MeshMotionError

from mesh_motion_server.session.journal.files import MANIFEST, SLOTS, read_ledger, read_stored_state
from mesh_motion_server.session.journal.filesystem import FileSystem, read_whole, unreadable
from mesh_motion_server.session.journal.ledger import Ledger
from mesh_motion_server.session.journal.mesh_store import MESH, verifies
from mesh_motion_server.session.spec import MOST_SPEC_BYTES, SPEC, StoredSpec, check_digest
from mesh_motion_server.session.state import State

UNREADABLE = "UNREADABLE"
"""State of a session in lists if the system does not give its files: nothing is known to be lost."""

#: Maximum number of cached sessions, the most recently requested ones; some 10 MB.
_MOST = 10_000
#: A file that was changed less than this many seconds ago may change again with the same time stamp: file system
#: clocks tick in milliseconds to seconds.
_SETTLED_SECONDS = 2.5

#: Meshes and states up to this size are compared with their digests: a thousand of them are read in about two seconds.
_VERIFIED_BYTES = 1 << 20

_HINT = "restore the session's folder from a backup"

Value = TypeVar("Value")
Stamp = tuple[int, int, int, int, int]


@dataclass(frozen=True)
class StoredSession:
    """A session at rest, for lists; holds no secret."""

    session: str
    label: str
    dimension: int
    partitions: int
    step: int
    #: READY; FAILED if files are missing or cut, or if the journal, the spec, or a mesh or last state of up to 1 MiB
    #: does not verify; UNREADABLE if they cannot be read. Larger files are verified only by RESUME and inspect, because
    #: gigabytes must be read.
    state: str
    owner: str = ""  # the public key of the user who opened it; empty on a server without keys


class _Journal(NamedTuple):
    """The used part of a journal: the last step, and the ledger without its commits."""

    step: int
    ledger: Ledger


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
        """Return the result of ``read`` for the file or folder, cached if the file has not changed."""
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
        self._specs: Remembered[tuple[bytes, StoredSpec | DataLoss]] = Remembered(_MOST)
        self._journals: Remembered[_Journal] = Remembered(_MOST)
        self._meshes: Remembered[bool] = Remembered(_MOST)
        self._states: Remembered[None] = Remembered(_MOST)

    def spec(self, folder: Path) -> StoredSpec:
        """The values that OPEN fixed.

        Raises DataLoss if the file cannot be read, does not have the digest in the journal, or is another session's.
        """

        try:
            digest = self._journal(folder).ledger.foundation.spec
        except MeshMotionError:  # a damaged journal has no digest; RESUME refuses it
            digest = None
        return self._checked_spec(folder, digest)

    def _checked_spec(self, folder: Path, digest: bytes | None) -> StoredSpec:
        raw, spec = self._read_spec(folder)
        if digest is not None:
            check_digest(raw, digest)  # first: damage must not be reported as another version
        if isinstance(spec, DataLoss):
            raise spec
        if spec.session != folder.name:
            raise DataLoss(f"the folder {folder.name} holds session {spec.session}", hint=_HINT, details={"file": SPEC})
        return spec

    def _read_spec(self, folder: Path) -> tuple[bytes, StoredSpec | DataLoss]:
        """Read the file; return its content, or the reason why it cannot be read."""

        def read() -> tuple[bytes, StoredSpec | DataLoss]:
            try:
                raw = read_whole(self._files, folder / SPEC, MOST_SPEC_BYTES)
            except OSError as error:
                raise unreadable("the session's spec", error) from error
            try:
                return raw, StoredSpec.from_bytes(raw)
            except DataLoss as error:
                return raw, error

        return self._specs.get(folder / SPEC, read)

    def _journal(self, folder: Path) -> _Journal:
        def read() -> _Journal:
            ledger = read_ledger(folder, self._files)
            return _Journal(ledger.step, replace(ledger, commits=()))

        return self._journals.get(folder / MANIFEST, read)

    def owner(self, folder: Path) -> str:
        """The owner of the session; empty if it cannot be read."""
        try:
            _, spec = self._read_spec(folder)
        except MeshMotionError:
            return ""
        return "" if isinstance(spec, DataLoss) else spec.owner

    def _require_files(self, folder: Path, ledger: Ledger) -> None:
        """Raise if a file that every session has is missing, is cut or, if it is small, does not verify."""
        foundation, last = ledger.foundation, ledger.snapshot
        for name in (MESH, *SLOTS):
            path = folder / name
            try:
                if not self._files.exists(path):
                    raise DataLoss(f"{name} is missing", hint=_HINT)
                if name == MESH:
                    read = partial(verifies, path, self._files, foundation.mesh, _VERIFIED_BYTES)
                    whole = self._meshes.get(path, read)
                elif last is None or name != SLOTS[last.slot]:
                    continue
                elif foundation.state_bytes <= _VERIFIED_BYTES:
                    self._states.get(path, partial(self._require_state, folder, ledger))
                    continue
                else:
                    whole = os.stat(path).st_size >= foundation.record_area + foundation.state_bytes
            except OSError as error:
                raise unreadable(name, error) from error
            if not whole:
                raise DataLoss(f"{name} is not the file that was written", hint=_HINT)

    def _require_state(self, folder: Path, ledger: Ledger) -> None:
        try:
            read_stored_state(folder, self._files, ledger)
        except DataLoss:
            if read_ledger(folder, self._files).snapshot == ledger.snapshot:
                raise
            # a session that is not at rest has committed again in the meantime

    def describe(self, folder: Path) -> StoredSession:
        """Describe a session at rest; only parts of large files are read, each only once."""
        owner = self.owner(folder)
        try:
            journal = self._journal(folder)
            spec = self._checked_spec(folder, journal.ledger.foundation.spec)
            self._require_files(folder, journal.ledger)
        except MeshMotionError as error:
            state = UNREADABLE if error.code == "RESOURCE_EXHAUSTED.DISK" else State.FAILED
            return StoredSession(folder.name, "", 0, 0, 0, state, owner)
        return StoredSession(folder.name, spec.label, spec.dimension, spec.partitions, journal.step, State.READY, owner)
