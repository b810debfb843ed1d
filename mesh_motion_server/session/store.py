"""The sessions on disk: one folder each, held by one process at a time.

::

    STATE FOLDER/sessions/<session id>/      0700
        lock                                 flock of the process that holds the session
        unbuilt                              until BUILD is durable: the session may be removed
        spec.json                            the values that OPEN fixed; only the token's sha256
        mesh.bin                             the mesh as uploaded
        manifest, slot-0, slot-1             the journal
        history/                             for people to read; nothing depends on it

The digests of ``spec.json`` and ``mesh.bin`` are in the journal's first record. A session that was never built is not
durable, cannot be resumed, and its folder is removed when no process holds it. A missing manifest does not prove that
(a backup may be restored in part): ``unbuilt`` does. An error of the disk never counts as a missing file.
"""

import contextlib
import errno
import hashlib
import os
import re
import shutil
import stat
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

from mesh_motion_protocol.errors import ResourceExhausted, SessionError

from mesh_motion_server.failpoints import failpoint
from mesh_motion_server.security.authorisation import not_found
from mesh_motion_server.session.journal.background_call import BackgroundCall
from mesh_motion_server.session.journal.durability import log_bytes
from mesh_motion_server.session.journal.files import FIRST_MANIFEST, KEPT_COMMITS, MANIFEST, SLOTS, read_journal
from mesh_motion_server.session.journal.filesystem import (
    FileSystem,
    PosixFileSystem,
    disk_failure,
    make_durable_folder,
    read_whole,
    write_file,
)
from mesh_motion_server.session.journal.journal import Journal, record_area
from mesh_motion_server.session.journal.ledger import Foundation
from mesh_motion_server.session.journal.mesh_store import MESH, read_mesh, write_mesh
from mesh_motion_server.session.listing import UNREADABLE, Listing, Remembered, StoredSession
from mesh_motion_server.session.partitions.meshes import PartitionMesh
from mesh_motion_server.session.spec import MOST_SPEC_BYTES, SPEC, SessionSpec, StoredSpec, check_digest
from mesh_motion_server.session.unbuilt import UNBUILT, mark_built, never_built

_LOCK = "lock"
_disk_error = partial(disk_failure, ResourceExhausted)
#: A mesh with at least this many bytes of coordinates is written in a thread.
_LARGE_MESH = 4 << 20
_SESSION_ID = re.compile(r"[0-9a-f]{32}")
_DISCARDED = re.compile(r"[0-9a-f]{32}\.discarded")


class SessionFolder:
    """One session's folder, held by this process until :meth:`release`."""

    def __init__(self, path: Path, files: FileSystem, lock: int) -> None:
        self.path = path
        self._raw_spec = read_whole(files, path / SPEC, MOST_SPEC_BYTES)
        self.spec = StoredSpec.from_bytes(self._raw_spec)
        self._files = files
        self._lock: int | None = lock
        self._mesh: BackgroundCall[bytes] | None = None

    @contextlib.contextmanager
    def writing_mesh(self, partitions: Sequence[PartitionMesh]) -> Iterator[None]:
        """Write a large mesh while it is checked, for :meth:`build`; a refused mesh is removed again."""
        if sum(partition.points.nbytes for partition in partitions) < _LARGE_MESH:
            yield
            return
        self._mesh = BackgroundCall(partial(write_mesh, self.path / MESH, self._files, partitions))
        try:
            yield
        except BaseException:
            self._mesh.wait()
            self._mesh = None
            self._remove_half_made()
            raise

    def build(self, partitions: Sequence[PartitionMesh], nodes: int, snapshot_steps: int, *, epoch: int = 1) -> Journal:
        """Make the mesh durable and start the journal.

        Raises ResourceExhausted: RESOURCE_EXHAUSTED.DISK if the disk cannot store it; the session is then unchanged.

        Parameters
        ----------
        partitions : sequence of PartitionMesh
            The same as for :meth:`writing_mesh`, if that was entered before.
        nodes : int
            Number of nodes of all partitions, each counted once.
        snapshot_steps : int
            With durability "replay": number of commits after which a state is stored.
        """
        level, dimension = self.spec.durability, self.spec.dimension
        replay = level == "replay"
        mesh, self._mesh = self._mesh, None
        try:
            foundation = Foundation(
                session=self.spec.session,
                spec=hashlib.sha256(self._raw_spec).digest(),
                mesh=mesh.result() if mesh else write_mesh(self.path / MESH, self._files, partitions),
                nodes=nodes,
                dimension=dimension,
                record_area=record_area(len(partitions), KEPT_COMMITS if level == "relaxed" else 1),
                durability=level,
                snapshot_steps=snapshot_steps if replay else 0,
                log_bytes=log_bytes(8 * nodes * dimension) if replay else 0,
            )
            failpoint("store.mesh.written")
            journal = Journal.create(self.path, self._files, foundation, epoch=epoch)
            try:
                mark_built(self._files, self.path)
            except OSError:
                journal.close()
                raise
            return journal
        except OSError as error:
            self._remove_half_made()
            raise _disk_error("the session cannot be stored", error) from error

    def _remove_half_made(self) -> None:
        """Remove the files of a failed BUILD, to free space; with a manifest they may be complete and are kept."""
        with contextlib.suppress(OSError):
            if not self._files.exists(self.path / MANIFEST):
                for name in (MESH, *SLOTS, FIRST_MANIFEST):
                    self._files.remove(self.path / name)

    def load(self) -> tuple[Journal, list[PartitionMesh]]:
        """Open the journal and read the mesh; a session that is refused is not changed.

        Raises DataLoss if anything does not verify.
        """
        found = read_journal(self.path, self._files)
        foundation = found.ledger.foundation
        check_digest(self._raw_spec, foundation.spec)
        try:
            mesh = read_mesh(self.path / MESH, self._files, foundation.mesh)
            journal = Journal.open(self.path, self._files, found)
            try:
                mark_built(self._files, self.path)  # a crash may have prevented BUILD from removing it
            except OSError:
                journal.close()
                raise
            return journal, mesh
        except OSError as error:
            raise _disk_error("the session cannot be opened", error) from error

    def release(self) -> None:
        """Let other processes hold the session; idempotent."""
        if self._lock is not None:
            self._files.close(self._lock)
            self._lock = None


class SessionStore:
    """All sessions under one state folder.

    Parameters
    ----------
    root : Path
        The state folder; ``~`` is expanded, missing folders are made with the first session.
    identity : (int, int), optional
        Its device and number, if another process knows them: no other folder is taken for it.
    """

    def __init__(
        self, root: Path | str, *, files: FileSystem | None = None, identity: tuple[int, int] | None = None
    ) -> None:
        self.root = Path(root).expanduser()
        self._files = files or PosixFileSystem()
        self._sessions = self.root / "sessions"
        self._listing = Listing(self._files)
        self._names: Remembered[list[str]] = Remembered(1)
        self.identity = identity or _identity(self.root)

    def create(self, spec: SessionSpec) -> SessionFolder:
        """Make a folder for a new session, held by this process.

        Raises SessionError if there is a session with this id. Raises ResourceExhausted: RESOURCE_EXHAUSTED.DISK if the
        disk cannot store it.
        """
        path = self._path(spec.session)
        lock, made = None, False
        try:
            self._require_same_root()
            make_durable_folder(self._files, self._sessions)
            if self._files.exists(path):
                raise SessionError(f"there is a session {spec.session!r} already", hint="take a new id")
            self._files.make_folder(path)
            made = True
            failpoint("store.create.folder-made")
            lock = self._files.lock(path / _LOCK)
            self._files.close(self._files.create(path / UNBUILT, 0))
            write_file(self._files, path / SPEC, StoredSpec.of(spec).to_bytes())
            failpoint("store.create.spec-written")
            self._files.sync_folder(self._sessions)  # the folder's own entries are synced with the manifest
            return SessionFolder(path, self._files, lock)
        except OSError as error:
            if made:
                shutil.rmtree(path, ignore_errors=True)
            if lock is not None:
                self._files.close(lock)
            raise _disk_error("the session cannot be stored", error) from error

    def open(self, session: str, token: bytes) -> SessionFolder:
        """Open an existing session's folder, and hold it in this process.

        Raises SessionError: NOT_FOUND, the same for an unknown session, a wrong token, and a session that was never
        built; UNAVAILABLE.STARTING while another process holds it.
        """
        self.check_token(session, token)
        path = self._path(session)
        try:
            lock = self._files.lock(path / _LOCK)
        except BlockingIOError as error:
            raise SessionError(
                f"session {session} is still held by another process",
                code="UNAVAILABLE.STARTING",
                hint="try again in a moment",
            ) from error
        except OSError as error:
            raise _disk_error("the session cannot be opened", error) from error
        try:
            failpoint("store.open.locked")
            return SessionFolder(path, self._files, lock)
        except OSError as error:
            self._files.close(lock)
            raise _disk_error("the session cannot be opened", error) from error
        except BaseException:
            self._files.close(lock)
            raise

    def owner(self, session: str) -> str | None:
        """The public key of a stored session's owner, ``""`` if it was opened without keys; None: no such session.

        Raises DataLoss if the session's spec cannot be read.
        """
        if not self._is_stored(session):
            return None
        return self._listing.spec(self._sessions / session).owner

    def check_token(self, session: str, token: bytes) -> StoredSpec:
        """The spec of the session with this token.

        Raises SessionError: NOT_FOUND, the same for an unknown session, a wrong token, and a session that was never
        built.
        """
        if not self._is_stored(session):
            raise not_found(session)
        spec = self._listing.spec(self._path(session))
        if not spec.admits(token):
            raise not_found(session)
        return spec

    def names(self) -> list[str]:
        """Names of folders that may be sessions, by id.

        Raises ResourceExhausted: RESOURCE_EXHAUSTED.DISK if the disk fails.
        """
        try:
            failpoint("store.list")
            self._require_same_root()
            return self._names.get(self._sessions, lambda: list(filter(_SESSION_ID.fullmatch, self._listed())))
        except OSError as error:
            raise _disk_error("the sessions cannot be listed", error) from error

    def owner_listed(self, session: str) -> str | None:
        """Like :meth:`owner`, but ``""`` if the owner cannot be read."""
        try:
            return self._listing.owner(self._sessions / session) if self._is_stored(session) else None
        except ResourceExhausted:
            return ""

    def describe(self, session: str) -> StoredSession:
        """A stored session for lists; reads only the manifest's chain, and nothing that was read before."""
        try:
            self._is_stored(session)
        except ResourceExhausted:
            return StoredSession(session, "", 0, 0, 0, UNREADABLE)
        return self._listing.describe(self._path(session))

    def sessions(self) -> list[StoredSession]:
        """The sessions that can be resumed, by id. Raises ResourceExhausted as :meth:`names`."""
        return [self.describe(name) for name in self.names() if self.owner_listed(name) is not None]

    def discard(self, session: str) -> None:
        """Delete a session that this process or no process holds; not an error if it is gone.

        Raises ResourceExhausted: RESOURCE_EXHAUSTED.DISK if the disk refuses it; the session is then unchanged.
        """
        path = self._path(session)
        # rename first: a session that a crash has deleted in part is not a session
        away = path.with_name(f"{session}.discarded")
        try:
            self._require_same_root()
            if self._files.exists(path):
                self._files.rename(path, away)
        except OSError as error:
            raise _disk_error("the session cannot be discarded", error) from error
        # it is gone for all programs; if this fails, a loss of power may at worst bring it back
        with contextlib.suppress(OSError):
            failpoint("store.discard.renamed")
            self._files.sync_folder(self._sessions)
        shutil.rmtree(away, ignore_errors=True)

    def sweep(self) -> list[str]:
        """Remove partly deleted sessions, and sessions that were never built and are not held; return their names."""
        failpoint("store.sweep")
        try:
            self._require_same_root()
            names = sorted(self._listed(), key=lambda name: not _DISCARDED.fullmatch(name))
            return [name for name in names if self._swept(self._sessions / name)]
        except OSError as error:
            raise _disk_error("the sessions cannot be listed", error) from error

    def _swept(self, path: Path) -> bool:
        """Remove a folder if it is partly deleted, or never built and not held; return whether it is gone.

        A link, and a folder that cannot be read, are kept.
        """
        if _DISCARDED.fullmatch(path.name):
            return self._removed(path)
        try:
            if stat.S_ISLNK(os.lstat(path).st_mode) or not (
                _SESSION_ID.fullmatch(path.name) and never_built(self._files, path)
            ):
                return False
            lock = self._files.lock(path / _LOCK)
        except OSError:
            return False
        try:
            return never_built(self._files, path) and self._removed(path)  # it may have been built in the meantime
        except OSError:
            return False
        finally:
            self._files.close(lock)

    def _removed(self, path: Path) -> bool:
        shutil.rmtree(path, ignore_errors=True)
        return not self._files.exists(path)

    def _is_stored(self, session: str) -> bool:
        """Whether there is such a session; a session whose folder lost files still exists, with lost data.

        Raises ResourceExhausted: RESOURCE_EXHAUSTED.DISK if the folder cannot be read.
        """
        if not _SESSION_ID.fullmatch(session):
            return False
        path = self._sessions / session
        try:
            self._require_same_root()
            return self._files.exists(path) and not never_built(self._files, path)
        except OSError as error:
            raise _disk_error(f"session {session} cannot be read", error) from error

    def _path(self, session: str) -> Path:
        if not _SESSION_ID.fullmatch(session):
            raise not_found(session)
        return self._sessions / session

    def _require_same_root(self) -> None:
        """Raise if the state folder was moved away or unmounted: nothing is known about its sessions then."""
        now = _identity(self.root)
        if self.identity is None:  # the first session makes it
            self.identity = now
        elif now != self.identity:
            raise OSError(errno.ESTALE, "it was moved or unmounted", str(self.root))

    def _listed(self) -> list[str]:
        """The names in the folder of sessions; none if the folder does not exist yet."""
        try:
            return sorted(self._files.names(self._sessions))
        except FileNotFoundError:
            return []


def _identity(folder: Path) -> tuple[int, int] | None:
    """Device and number of a folder; None if it is not there, or not in a file system of the operating system."""
    try:
        found = os.stat(folder)
    except OSError:
        return None
    return found.st_dev, found.st_ino
