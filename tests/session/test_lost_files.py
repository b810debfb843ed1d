"""Files of sessions that are missing, or that the system cannot read: nothing is removed, and the other sessions are
served.
"""

import errno
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from mesh_motion_protocol.errors import DataLoss, MeshMotionError, ResourceExhausted

from mesh_motion_server.session.inspection import inspect_session
from mesh_motion_server.session.journal.filesystem import PosixFileSystem
from mesh_motion_server.session.listing import UNREADABLE
from mesh_motion_server.session.spec import SPEC
from mesh_motion_server.session.state import State
from mesh_motion_server.session.store import SessionStore
from mesh_motion_server.session.unbuilt import UNBUILT
from mesh_motion_server.settings import ServerSettings
from tests.faults.driver import SESSION, TOKEN, make_driver, make_spec, resume
from tests.faults.stand_in import grid_mesh

OTHER = "f" * 32


def build(store: SessionStore, session: str = SESSION, steps: int = 1, **options: Any) -> Path:
    driver = make_driver(store, [grid_mesh()], session=session, **options)
    driver.open()
    for step in range(1, steps + 1):
        driver.advance(step)
    driver.host.close()
    return store.root / "sessions" / session


@pytest.fixture
def store(tmp_path: Path) -> SessionStore:
    return SessionStore(tmp_path)


def load(store: SessionStore, session: str = SESSION) -> None:
    folder = store.open(session, TOKEN)
    try:
        folder.load()[0].close()
    finally:
        folder.release()


def content(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


@pytest.mark.parametrize("durability", ["full", "relaxed", "replay"])
@pytest.mark.parametrize("steps", [0, 1, 3])
def test_a_built_session_without_its_manifest_is_lost_data_and_stays(
    store: SessionStore, durability: str, steps: int
) -> None:
    folder = build(store, steps=steps, spec={"durability": durability})
    for lost in (["manifest"], ["manifest.new"], ["slot-0"], ["slot-1"], ["mesh.bin"]):
        (folder / lost[0]).unlink()
        before = content(folder)
        assert store.sweep() == []
        assert content(folder) == before
        with pytest.raises(DataLoss) as caught:
            load(store)
        assert caught.value.code == "DATA_LOSS.CHECKSUM"
        assert "manifest: No such file" in str(caught.value)  # the first of those that are lost by now
        assert [found.state for found in store.sessions()] == [State.FAILED]
        assert inspect_session(folder).state == "damaged"


def change_last_byte(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-1] + b"!")


def make_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


@pytest.mark.parametrize("durability", ["full", "relaxed", "replay"])
@pytest.mark.parametrize(
    ("names", "damage"),
    [
        (["mesh.bin"], Path.unlink),
        (["mesh.bin"], change_last_byte),
        ([SPEC], Path.unlink),
        ([SPEC], change_last_byte),
        (["slot-0", "slot-1"], change_last_byte),
        (["manifest.new"], make_folder),
    ],
)
def test_a_resume_that_is_refused_changes_nothing(
    store: SessionStore, durability: str, names: list[str], damage: Callable[[Path], None]
) -> None:
    """Even if a crash left a journal that needs repair."""
    limits = ServerSettings(snapshot_steps=2)
    driver = make_driver(store, [grid_mesh()], spec={"durability": durability}, limits=limits)
    driver.open()
    for step in (1, 2, 3):
        driver.advance(step)
    driver.host._session.catch_up()  # with "relaxed" a slot may not be written yet, and nothing needs it
    folder = store.root / "sessions" / SESSION
    shutil.copytree(folder, kept := store.root / "kept")
    driver.host.close()
    shutil.rmtree(folder)
    kept.rename(folder)
    for name in names:
        damage(folder / name)
    before = content(folder)
    with pytest.raises(MeshMotionError):
        resume(store)
    assert content(folder) == before


@pytest.mark.parametrize("durability", ["full", "relaxed", "replay"])
@pytest.mark.parametrize("steps", [0, 3])
def test_an_older_backups_mark_among_newer_files_removes_nothing(
    store: SessionStore, durability: str, steps: int
) -> None:
    """An old folder from before BUILD was copied over it, and the manifest was lost."""
    folder = build(store, steps=steps, spec={"durability": durability})
    (folder / UNBUILT).touch()
    (folder / "manifest").unlink()
    lost = [["slot-0", "slot-1"], ["mesh.bin"], ["manifest.new"]] if steps else [["slot-0", "slot-1"], ["mesh.bin"]]
    for names in lost:  # one after the other: at last the history alone has the steps
        for name in names:
            (folder / name).unlink()
        before = content(folder)
        assert store.sweep() == []
        assert content(folder) == before
        assert [found.state for found in store.sessions()] == [State.FAILED]


def test_sessions_that_were_never_built_are_removed(store: SessionStore) -> None:
    folder = store.create(make_spec())
    folder.release()
    empty = store.root / "sessions" / OTHER
    empty.mkdir()
    foreign = store.root / "sessions" / "notes.discarded"
    foreign.mkdir()
    assert inspect_session(folder.path).state == "unbuilt"
    assert store.sessions() == []
    assert store.sweep() == [SESSION, OTHER]
    assert os.listdir(store.root / "sessions") == [foreign.name]


def test_the_mark_of_an_unbuilt_session_ends_with_its_build(store: SessionStore) -> None:
    folder = build(store)
    assert not (folder / UNBUILT).exists()
    (folder / UNBUILT).touch()  # as a crash directly after the manifest leaves it
    load(store)
    assert not (folder / UNBUILT).exists()


def test_unknown_files_and_links_are_no_proof(store: SessionStore, tmp_path: Path) -> None:
    kept = store.root / "sessions" / SESSION
    kept.mkdir(parents=True)
    for name in ("lock", "manifest.away", "slot-0.bak"):
        (kept / name).touch()
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (store.root / "sessions" / OTHER).symlink_to(elsewhere)
    assert store.sweep() == []
    assert sorted(os.listdir(kept)) == ["lock", "manifest.away", "slot-0.bak"]
    assert elsewhere.is_dir()


class Failing(PosixFileSystem):
    def __init__(self, name: str, error: int) -> None:
        self.name, self.error = name, error

    def exists(self, path: Path) -> bool:
        if self.name in path.parts:
            raise OSError(self.error, os.strerror(self.error))
        return super().exists(path)

    def open(self, path: Path, *, writable: bool = True) -> int:
        if self.name in path.parts:
            raise OSError(self.error, os.strerror(self.error))
        return super().open(path, writable=writable)


ERRORS = [number for name, number in vars(errno).items() if name in ("EIO", "ESTALE", "EACCES", "ELOOP", "ENOTDIR")]


@pytest.mark.parametrize("error", ERRORS)
@pytest.mark.parametrize("name", ["manifest", SPEC, UNBUILT, SESSION])
def test_an_error_of_the_disk_is_no_missing_file(store: SessionStore, name: str, error: int) -> None:
    folder = build(store)
    if name == UNBUILT:
        (folder / "manifest").unlink()
        (folder / "manifest.new").unlink()
    build(store, OTHER)
    failing = SessionStore(store.root, files=Failing(name, error))
    before = content(folder)
    assert failing.sweep() == []
    assert content(folder) == before
    states = {found.session: found.state for found in failing.sessions()}
    assert states[SESSION] == UNREADABLE
    assert name != SESSION or states[OTHER] == State.READY
    for ask in (lambda: failing.open(SESSION, TOKEN), lambda: failing.owner(SESSION)):
        with pytest.raises(MeshMotionError) as caught:
            ask()
        assert caught.value.code == "RESOURCE_EXHAUSTED.DISK"


class Counting(PosixFileSystem):
    """Refuses reads of more bytes than a small session has."""

    def read(self, handle: int, offset: int, size: int) -> bytes:
        assert size <= 4 << 20
        return super().read(handle, offset, size)


@pytest.mark.parametrize("damaged", [False, True])
@pytest.mark.parametrize("name", [SPEC, "manifest", "mesh.bin"])
def test_a_file_that_seems_huge_is_not_read(store: SessionStore, name: str, damaged: bool) -> None:
    """A file length from a damaged file system affects one session only, for any first bytes."""
    folder = build(store)
    if damaged:
        (folder / name).write_bytes(b"")
    os.truncate(folder / name, 1 << 42)
    counting = SessionStore(store.root, files=Counting())
    assert {found.state for found in counting.sessions()} <= {UNREADABLE, State.FAILED}
    with pytest.raises(MeshMotionError):
        load(counting)
    shown = inspect_session(folder)
    assert shown.state == "damaged"
    assert any("4398046511104 bytes" in check.message or "digest" in check.message for check in shown.checks)


@pytest.mark.parametrize("name", ["exists", "make_folder", "sync_folder"])
def test_a_session_is_not_removed_by_a_create_that_fails(
    store: SessionStore, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """An id that exists already, on a disk that does not report it."""
    before = content(build(store))

    def fail(*_: Any) -> Any:
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(PosixFileSystem, name, fail)
    if name != "sync_folder":
        with pytest.raises(ResourceExhausted):
            store.create(make_spec())
    assert content(store.root / "sessions" / SESSION) == before


def replace_by(make: Callable[[Path], object], name: str = "") -> Callable[[Path], None]:
    def replaced(folder: Path) -> None:
        path = folder / name if name else folder
        shutil.rmtree(path) if path.is_dir() else path.unlink()
        make(path)

    return replaced


BAD = {
    "file": replace_by(Path.touch),
    "dangling": replace_by(lambda path: path.symlink_to("nowhere")),
    "loop": replace_by(lambda path: path.symlink_to(path)),
    "manifest-folder": replace_by(Path.mkdir, "manifest"),
    "manifest-pipe": replace_by(os.mkfifo, "manifest"),
    "manifest-dangling": replace_by(lambda path: path.symlink_to("nowhere"), "manifest"),
    "manifest-empty": replace_by(Path.touch, "manifest"),
    "spec-folder": replace_by(Path.mkdir, SPEC),
    "spec-pipe": replace_by(os.mkfifo, SPEC),
    "spec-gone": replace_by(lambda path: None, SPEC),
    "slot-1-folder": replace_by(Path.mkdir, "slot-1"),
    "slot-1-pipe": replace_by(os.mkfifo, "slot-1"),
    "slot-1-dangling": replace_by(lambda path: path.symlink_to("nowhere"), "slot-1"),
    "mesh.bin-folder": replace_by(Path.mkdir, "mesh.bin"),
    "mesh.bin-pipe": replace_by(os.mkfifo, "mesh.bin"),
}


@pytest.mark.parametrize("kind", BAD)
def test_one_bad_folder_is_named_and_the_rest_is_served(store: SessionStore, kind: str) -> None:
    folder = build(store)
    build(store, OTHER)
    BAD[kind](folder)
    (store.root / "sessions" / "lost+found").mkdir()
    for _ in range(2):
        assert store.sweep() == []
        states = {found.session: found.state for found in store.sessions()}
        assert states == {SESSION: states[SESSION], OTHER: State.READY}
        assert states[SESSION] in (UNREADABLE, State.FAILED)
        assert kind not in ("file", "dangling", "loop") or states[SESSION] == UNREADABLE
        with pytest.raises(MeshMotionError) as caught:
            load(store)
        lost = not kind.endswith(("dangling", "loop", "file"))
        assert caught.value.code == ("DATA_LOSS.CHECKSUM" if lost else "RESOURCE_EXHAUSTED.DISK")
        assert kind.rpartition("-")[0] in str(caught.value)
        assert states[SESSION] == (State.FAILED if lost else UNREADABLE)
    load(store, OTHER)


def test_a_folder_with_the_name_of_another_session_is_refused(store: SessionStore) -> None:
    """As when two folders were exchanged, or one was copied next to itself: two workers would write one session."""
    folder = build(store)
    shutil.copytree(folder, folder.with_name(OTHER))
    states = {found.session: found.state for found in store.sessions()}
    assert states == {SESSION: State.READY, OTHER: State.FAILED}
    with pytest.raises(DataLoss, match=f"the folder {OTHER} holds session {SESSION}"):
        load(store, OTHER)
    load(store)


@pytest.mark.parametrize("empty", [False, True])
def test_a_state_folder_that_was_unmounted_has_not_lost_its_sessions(tmp_path: Path, empty: bool) -> None:
    """NOT_FOUND would let a client begin again, and OPEN would store sessions below the mount's place."""
    (root := tmp_path / "state").mkdir()
    store = SessionStore(root)
    build(store)
    root.rename(tmp_path / "away")
    if empty:
        root.mkdir()
    asks: list[Callable[[], object]] = [
        lambda: store.open(SESSION, TOKEN),
        lambda: store.owner(SESSION),
        store.names,
        store.sweep,
        lambda: store.create(make_spec(OTHER)),
        lambda: store.discard(SESSION),
    ]
    for ask in asks:
        with pytest.raises(ResourceExhausted, match="state: it was moved or unmounted") as caught:
            ask()
        assert caught.value.code == "RESOURCE_EXHAUSTED.DISK"
    assert not empty or os.listdir(root) == []
    if empty:
        root.rmdir()
    (tmp_path / "away").rename(root)
    assert [found.state for found in store.sessions()] == [State.READY]
    load(store)
