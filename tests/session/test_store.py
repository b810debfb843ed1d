"""Folders of sessions: rights, locks, lists, and removal."""

import json
import stat
from pathlib import Path
from typing import Any

import pytest
from mesh_motion_protocol.errors import DataLoss, MeshMotionError, ResourceExhausted, SessionError

from mesh_motion_server.session.listing import StoredSession
from mesh_motion_server.session.spec import StoredSpec
from mesh_motion_server.session.state import State
from mesh_motion_server.session.store import SessionStore
from mesh_motion_server.settings import ServerSettings
from tests.faults.driver import SESSION, TOKEN, make_driver, make_spec, resume
from tests.faults.model_files import ModelFiles
from tests.faults.stand_in import grid_mesh

OTHER = "f" * 32


@pytest.fixture
def store(tmp_path: Path) -> SessionStore:
    return SessionStore(tmp_path / "state")


def build(store: SessionStore, session: str = "", **options: Any) -> Any:
    driver = make_driver(store, [grid_mesh()], session=session or SESSION, **options)
    driver.open()
    return driver


def test_only_the_owner_may_look(store: SessionStore) -> None:
    driver = build(store, limits=ServerSettings(reserve_disk_bytes=0))
    driver.advance(1)
    driver.host.close()
    assert (store.root / "sessions" / SESSION / "history").is_dir()
    for path in [store.root / "sessions", *(store.root / "sessions").rglob("*")]:
        assert stat.S_IMODE(path.stat().st_mode) == (0o700 if path.is_dir() else 0o600), path


def test_the_token_is_not_stored(store: SessionStore) -> None:
    build(store).host.close()
    for path in filter(Path.is_file, (store.root / "sessions" / SESSION).rglob("*")):
        data = path.read_bytes()
        assert TOKEN not in data
        assert TOKEN.hex().encode() not in data


def test_sessions_are_listed_without_secrets(store: SessionStore) -> None:
    assert store.sessions() == []
    driver = build(store, spec={"label": "flag"})
    driver.advance(1)
    build(store, OTHER).host.close()
    assert store.sessions() == [
        StoredSession(SESSION, "flag", 2, 1, 1, State.READY),
        StoredSession(OTHER, "", 2, 1, 0, State.READY),
    ]
    (store.root / "sessions" / OTHER / "manifest").write_bytes(b"damage")
    assert store.sessions()[1] == StoredSession(OTHER, "", 0, 0, 0, State.FAILED)
    driver.host.close()


@pytest.mark.parametrize("session", ["0" * 32, "", "../../etc", "0" * 31 + "G", "0" * 33, "a/" * 16])
def test_an_unknown_session_and_a_wrong_token_are_alike(store: SessionStore, session: str) -> None:
    build(store).host.close()
    with pytest.raises(SessionError) as unknown:
        store.open(session, TOKEN)
    with pytest.raises(SessionError) as wrong:
        store.open(SESSION, bytes(32))
    assert unknown.value.code == wrong.value.code == "NOT_FOUND"
    assert unknown.value.message.replace(repr(session), "") == wrong.value.message.replace(repr(SESSION), "")
    with pytest.raises(SessionError):
        store.discard(session[:-1] + "x")


def test_a_session_is_held_once(store: SessionStore) -> None:
    driver = build(store)
    with pytest.raises(SessionError, match="already"):
        store.create(make_spec())
    with pytest.raises(SessionError, match="still held") as caught:
        store.open(SESSION, TOKEN)
    assert caught.value.code == "UNAVAILABLE.STARTING"
    driver.host.close()
    folder = store.open(SESSION, TOKEN)
    folder.release()
    folder.release()


def test_closing_a_session_that_was_never_built_removes_it(store: SessionStore) -> None:
    driver = make_driver(store, [grid_mesh()])
    driver.host.close()
    assert list((store.root / "sessions").iterdir()) == []


def test_a_state_folder_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ResourceExhausted) as caught:
        SessionStore(tmp_path / "file" / "below").create(make_spec())
    assert caught.value.code == "RESOURCE_EXHAUSTED.DISK"


@pytest.mark.parametrize("name", ["spec.json", "mesh.bin"])
def test_damage_of_what_is_immutable_is_found(store: SessionStore, name: str) -> None:
    build(store).host.close()
    path = store.root / "sessions" / SESSION / name
    data = path.read_bytes()
    for offset in range(0, len(data), max(1, len(data) // 100)):
        path.write_bytes(data[:offset] + bytes([data[offset] ^ 2]) + data[offset + 1 :])
        with pytest.raises(MeshMotionError) as caught:
            resume(store)
        assert isinstance(caught.value, (DataLoss, SessionError))
        assert caught.value.code == "DATA_LOSS.CHECKSUM"


def test_the_spec_is_json_and_survives_a_round_trip(store: SessionStore) -> None:
    build(store, spec={"label": "flügel"}).host.close()
    raw = (store.root / "sessions" / SESSION / "spec.json").read_bytes()
    values = json.loads(raw)
    assert values["label"] == "flügel"
    assert values["settings"]["basis"] == "wendland-c2"
    stored = StoredSpec.from_bytes(raw)
    assert stored.to_bytes() == raw
    assert stored.admits(TOKEN)
    assert not stored.admits(bytes(32))
    for damaged in (b"", b"[]", raw.replace(b'"format": 1', b'"format": 2'), raw.replace(b"wendland-c2", b"x" * 11)):
        if damaged.find(b"xxx") < 0:
            with pytest.raises(DataLoss):
                StoredSpec.from_bytes(damaged)


def test_a_home_folder_is_expanded(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    assert SessionStore("~/state").root == tmp_path / "state"


def test_the_folders_above_a_new_session_are_durable() -> None:
    files = ModelFiles()
    SessionStore(Path("/a/b"), files=files).create(make_spec())
    for folder in ("sessions", "b", "a"):
        assert f"sync_folder {folder}" in files.operations
    files.arm(None)
    SessionStore(Path("/a/b"), files=files).create(make_spec(OTHER))
    assert "sync_folder b" not in files.operations


def test_a_mesh_that_the_disk_does_not_give_is_no_lost_data(store: SessionStore, plan_fault: Any) -> None:
    build(store).host.close()
    plan_fault("store.mesh.read=raise:EIO@1")
    with pytest.raises(MeshMotionError, match="the mesh cannot be read") as caught:
        resume(store)
    assert caught.value.code == "RESOURCE_EXHAUSTED.DISK"
    resumed = resume(store)  # the lock was given back
    assert resumed.state == "READY"
    resumed.close()


def test_a_list_that_the_disk_does_not_give_is_an_error(store: SessionStore, plan_fault: Any) -> None:
    plan_fault("store.list=raise:EMFILE@1")
    with pytest.raises(ResourceExhausted, match="the sessions cannot be listed"):
        store.sessions()
    assert store.sessions() == []
