"""The store's files: locks and handles are released, a power loss loses nothing, and a full disk leaves nothing
behind.
"""

import errno
import threading
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest
from mesh_motion_protocol.errors import DataLoss, InvalidInput, ResourceExhausted, SessionError
from raising import raising

from mesh_motion_server.session import store as store_module
from mesh_motion_server.session.journal.filesystem import PosixFileSystem
from mesh_motion_server.session.listing import StoredSession
from mesh_motion_server.session.state import State
from mesh_motion_server.session.store import SessionStore
from tests.faults.driver import SESSION, TOKEN, make_spec
from tests.faults.model_files import FailingFiles, ModelFiles
from tests.faults.stand_in import grid_mesh

OTHER = "f" * 32
NODES = len(grid_mesh().points)


class Counted(PosixFileSystem):
    """Records open handles, and files opened for writing."""

    def __init__(self) -> None:
        self.handles: set[int] = set()
        self.written: set[str] = set()

    def _opened(self, handle: int) -> int:
        self.handles.add(handle)
        return handle

    def create(self, path: Path, size: int) -> int:
        return self._opened(super().create(path, size))

    def open(self, path: Path, *, writable: bool = True) -> int:
        if writable:
            self.written.add(path.name)
        return self._opened(super().open(path, writable=writable))

    def lock(self, path: Path) -> int:
        return self._opened(super().lock(path))

    def close(self, handle: int) -> None:
        self.handles.remove(handle)
        super().close(handle)


@pytest.fixture
def files() -> Counted:
    return Counted()


@pytest.fixture
def store(tmp_path: Path, files: Counted) -> SessionStore:
    return SessionStore(tmp_path, files=files)


def build(store: SessionStore, session: str = SESSION, **spec: Any) -> None:
    folder = store.create(make_spec(session, **spec))
    folder.build([grid_mesh()], NODES, 8).close()
    folder.release()


def in_folder(store: SessionStore, session: str = SESSION) -> set[str]:
    return {path.name for path in (store.root / "sessions" / session).iterdir()}


def test_a_session_at_rest_holds_no_file(store: SessionStore, files: Counted) -> None:
    build(store)
    assert files.handles == set()
    files.written.clear()
    folder = store.open(SESSION, TOKEN)
    assert (store.owner(SESSION), len(store.sessions())) == ("", 1)
    assert (files.written, len(files.handles)) == (set(), 1)
    journal, meshes = folder.load()
    assert not files.written & {"spec.json", "mesh.bin"}
    np.testing.assert_array_equal(meshes[0].points, grid_mesh().points)
    journal.close()
    folder.release()
    store.discard(SESSION)
    assert files.handles == set()


@pytest.mark.parametrize("name", ["spec.json", "mesh.bin"])
def test_a_load_that_fails_gives_the_journal_back(store: SessionStore, files: Counted, name: str) -> None:
    build(store, label="a")
    folder = store.open(SESSION, TOKEN)
    path = folder.path / name
    path.write_bytes(path.read_bytes().replace(b'"label": "a"', b'"label": "b"') + b" ")
    if name == "spec.json":
        folder.release()
        with pytest.raises(DataLoss, match="does not match its digest") as caught:
            store.open(SESSION, TOKEN)
        assert (caught.value.details, files.handles) == ({"file": name}, set())
        return
    with pytest.raises(DataLoss, match="does not match its digest") as caught:
        folder.load()
    assert caught.value.details == {"file": name}
    assert len(files.handles) == 1
    folder.release()


@pytest.mark.parametrize(("spare", "in_thread"), [(0, True), (1, False)])
def test_a_large_mesh_is_written_while_it_is_checked(
    store: SessionStore, monkeypatch: pytest.MonkeyPatch, spare: int, in_thread: bool
) -> None:
    mesh = grid_mesh()
    monkeypatch.setattr(store_module, "_LARGE_MESH", mesh.points.nbytes + spare)
    folder = store.create(make_spec())
    with folder.writing_mesh([mesh]):
        if in_thread:
            folder._mesh.wait()
        assert ("mesh.bin" in in_folder(store)) == in_thread
    folder.release()


def test_a_mesh_that_is_refused_is_removed_once_it_is_written(
    store: SessionStore, files: Counted, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(store_module, "_LARGE_MESH", 0)
    go_on, honest = threading.Event(), PosixFileSystem.write

    def held(self: Any, *given: Any) -> int:
        assert go_on.wait(30)
        return honest(self, *given)

    folder = store.create(make_spec())
    monkeypatch.setattr(PosixFileSystem, "write", held)
    threading.Timer(0.1, go_on.set).start()
    with pytest.raises(InvalidInput), folder.writing_mesh([grid_mesh()]):
        raise InvalidInput("unusable")
    assert (in_folder(store), len(files.handles)) == ({"lock", "spec.json", "unbuilt"}, 1)
    folder.build([grid_mesh()], NODES, 8).close()
    assert "mesh.bin" in in_folder(store)
    folder.release()


@pytest.mark.parametrize("point", ["folder-made", "spec-written"])
def test_a_session_that_the_disk_does_not_take_leaves_nothing(
    store: SessionStore, files: Counted, plan_fault: Any, point: str
) -> None:
    """A fault found by a mutation of the store: the lock of a folder that could not be created was never released."""
    plan_fault(f"store.create.{point}=raise:ENOSPC@1")
    with pytest.raises(ResourceExhausted, match="the session cannot be stored"):
        store.create(make_spec())
    assert list((store.root / "sessions").iterdir()) == []
    assert files.handles == set()
    store.create(make_spec()).release()


@pytest.mark.parametrize(
    ("fault", "error"), [("EIO", ResourceExhausted), ("MemoryError", MemoryError)], ids=["of the disk", "unforeseen"]
)
def test_a_lock_is_given_back_when_opening_fails(
    store: SessionStore, files: Counted, plan_fault: Any, fault: str, error: type[Exception]
) -> None:
    build(store)
    plan_fault(f"store.open.locked=raise:{fault}@1")
    with pytest.raises(error):
        store.open(SESSION, TOKEN)
    assert files.handles == set()
    store.open(SESSION, TOKEN).release()


def test_a_lock_that_the_system_refuses_is_reported(store: SessionStore, monkeypatch: pytest.MonkeyPatch) -> None:
    build(store)
    monkeypatch.setattr(Counted, "lock", raising(OSError(errno.EMFILE, "Too many open files")))
    with pytest.raises(ResourceExhausted, match="the session cannot be opened: Too many open files") as caught:
        store.open(SESSION, TOKEN)
    assert caught.value.details == {"errno": "EMFILE"}


def test_the_owner_of_a_session_is_found(store: SessionStore) -> None:
    build(store, owner="key")
    store.create(make_spec(OTHER)).release()
    assert [store.owner(session) for session in (SESSION, OTHER, "e" * 32)] == ["key", None, None]
    assert store.owner(f"../sessions/{SESSION}") is None
    (store.root / "sessions" / SESSION / "manifest").write_bytes(b"damage")
    assert store.sessions() == [StoredSession(SESSION, "", 0, 0, 0, State.FAILED, "key")]
    (store.root / "sessions" / SESSION / "spec.json").unlink()
    assert store.sessions() == [StoredSession(SESSION, "", 0, 0, 0, State.FAILED)]
    with pytest.raises(DataLoss, match="the session's spec cannot be read"):
        store.owner(SESSION)


def test_sweeping_looks_at_every_folder_and_gives_its_locks_back(store: SessionStore, files: Counted) -> None:
    build(store)
    for session in ("a" * 32, OTHER):
        store.create(make_spec(session)).release()
    sessions = store.root / "sessions"
    (sessions / f"{'d' * 32}.discarded").write_bytes(b"no folder, which cannot be removed as one")
    (sessions / f"{'e' * 32}.discarded").mkdir()
    held = store.create(make_spec("c" * 32))
    with pytest.raises(SessionError) as unbuilt:
        store.open(OTHER, TOKEN)
    assert unbuilt.value.code == "NOT_FOUND"
    assert set(store.sweep()) == {f"{'e' * 32}.discarded", "a" * 32, OTHER}
    assert in_folder(store, "c" * 32) == {"lock", "spec.json", "unbuilt"}
    held.release()
    assert files.handles == set()
    assert store.sweep() == ["c" * 32]
    assert [each.session for each in store.sessions()] == [SESSION]


def test_how_much_is_logged_before_a_state_is_stored() -> None:
    store = SessionStore("/state", files=ModelFiles())
    folder = store.create(make_spec(durability="replay"))
    foundation = folder.build([grid_mesh()], 400_000, 7).ledger.foundation
    assert (foundation.snapshot_steps, foundation.log_bytes) == (7, 400_000 * 8)
    assert (foundation.durability, foundation.state_bytes, foundation.record_area) == ("replay", 6_400_000, 20_480)


def test_a_session_that_was_built_is_there_after_a_loss_of_power() -> None:
    for seed in range(20):
        files = ModelFiles()
        store = SessionStore("/state", files=files)
        folder = store.create(make_spec())
        folder.build([grid_mesh()], NODES, 8)
        files.lose_power(Random(seed))
        journal, _ = store.open(SESSION, TOKEN).load()
        assert journal.ledger.step == 0


def test_a_discarded_session_is_gone_after_a_loss_of_power() -> None:
    files = ModelFiles()
    store = SessionStore("/state", files=files)
    build(store)
    files.arm(None)
    store.discard(SESSION)
    assert files.operations == [f"rename {SESSION}.discarded", "sync_folder sessions"]
    files.arm(None)
    store.discard(SESSION)
    assert "rename" not in " ".join(files.operations)


def test_a_session_that_the_disk_does_not_let_go_is_as_before() -> None:
    files = FailingFiles(ModelFiles(), for_ever=False)
    store = SessionStore("/state", files=files)
    build(store)
    files.fail_at = files.count + 1
    with pytest.raises(ResourceExhausted, match="the session cannot be discarded"):
        store.discard(SESSION)
    assert store.check_token(SESSION, TOKEN).session == SESSION


@pytest.mark.parametrize("session", [f"../sessions/{SESSION}", f"{SESSION}/", f"./{SESSION}"])
def test_a_session_is_found_by_its_id_and_by_no_path(store: SessionStore, session: str) -> None:
    build(store)
    with pytest.raises(SessionError, match="already"):
        store.create(make_spec())
    for ask in (lambda: store.open(session, TOKEN), lambda: store.discard(session)):
        with pytest.raises(SessionError) as caught:
            ask()
        assert caught.value.code == "NOT_FOUND"
    assert store.check_token(SESSION, TOKEN).session == SESSION


def test_sweeping_gives_the_lock_of_a_folder_back_that_cannot_be_removed(
    store: SessionStore, files: Counted, monkeypatch: pytest.MonkeyPatch
) -> None:
    store.create(make_spec()).release()

    def refuse(path: Path, ignore_errors: bool = False) -> None:
        if not ignore_errors:
            raise OSError(errno.EACCES, "Permission denied")

    monkeypatch.setattr("shutil.rmtree", refuse)
    store.sweep()
    assert files.handles == set()


def test_a_build_without_room_leaves_nothing_but_what_open_made() -> None:
    made, fail_at = False, 0
    while not made:
        fail_at += 1
        files = FailingFiles(ModelFiles(), error=errno.ENOSPC, for_ever=False)
        store = SessionStore("/state", files=files)
        folder = store.create(make_spec())
        files.fail_at = files.count + fail_at
        try:
            folder.build([grid_mesh()], NODES, 8)
            made = True
        except ResourceExhausted:
            left = {path.name for path in files.entries}
            assert left == {"spec.json", "unbuilt"} or "manifest" in left
    assert fail_at > 10
