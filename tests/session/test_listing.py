"""Reads of lists in a journal: only the needed parts, with the same result as from the whole."""

import os
from pathlib import Path
from typing import Any

import pytest
from mesh_motion_protocol.messages import Commit, Move

from mesh_motion_server.session import listing
from mesh_motion_server.session.journal.files import MANIFEST, read_ledger
from mesh_motion_server.session.journal.filesystem import PosixFileSystem
from mesh_motion_server.session.journal.mesh_store import verifies
from mesh_motion_server.session.journal.recovery import read_chain, sum_up
from mesh_motion_server.session.store import SessionStore
from mesh_motion_server.transport import registry
from tests.faults.driver import SESSION, make_driver, resume_driver
from tests.faults.model_files import ModelFiles
from tests.faults.stand_in import grid_mesh


class CountingFiles(ModelFiles):
    read_bytes = 0

    def read(self, handle: int, offset: int, size: int) -> bytes:
        data = super().read(handle, offset, size)
        self.read_bytes += len(data)
        return data


@pytest.fixture
def journal() -> Any:
    files = CountingFiles()
    driver = make_driver(SessionStore("/state", files=files), [grid_mesh()])
    driver.open()
    yield driver, files, Path("/state/sessions") / SESSION
    driver.host.close()


def advance(driver: Any, steps: int) -> None:
    for step in range(driver.host.step + 1, driver.host.step + steps + 1):
        sign = 1 if step % 2 else -1
        driver.all(Move, [0.01 * sign * rows for rows in driver.displacement((step + 1) // 2)], step=step)
        driver.all(Commit, step=step)


def test_a_list_reads_what_is_used_and_finds_the_same(journal: Any) -> None:
    driver, files, folder = journal
    for steps in (0, 1, 12, 1, 1, 1, 50, 200):  # across the parts that are read, and into the second manifest
        advance(driver, steps)
        whole = bytes(files.entries[folder / MANIFEST].cache)
        before = files.read_bytes
        ledger = read_ledger(folder, files)
        read = files.read_bytes - before
        records, _ = read_chain(whole)
        assert ledger == sum_up(records, keep=1)
        assert ledger.step == driver.host.step
        assert read <= 2 * len(whole)
    assert len(whole) >= 1 << 20


def test_a_young_session_is_listed_by_64_kib(journal: Any) -> None:
    driver, files, folder = journal
    advance(driver, 3)
    before = files.read_bytes
    read_ledger(folder, files)
    assert files.read_bytes - before == 64 << 10


OTHERS = [letter * 32 for letter in "bcde"]


@pytest.fixture
def five(tmp_path: Path) -> SessionStore:
    """A store on a real disk with five sessions at rest."""
    store = SessionStore(tmp_path)
    for session in (SESSION, *OTHERS):
        driver_at_rest(store, session)
    return store


def driver_at_rest(store: SessionStore, session: str) -> Any:
    driver = make_driver(store, [grid_mesh()], session=session)
    driver.open()
    advance(driver, 1)
    driver.host.close()
    return driver


@pytest.fixture
def reads(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    found: list[str] = []

    def counting(folder: Path, files: Any) -> Any:
        found.append(folder.name)
        return read_ledger(folder, files)

    monkeypatch.setattr(listing, "read_ledger", counting)
    return found


def names_of(page: Any) -> list[str]:
    return [entry["session"] for _, entry in page]


def test_a_page_reads_its_own_sessions_and_each_once(
    five: SessionStore, reads: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(listing, "_SETTLED_SECONDS", -1.0)
    monkeypatch.setattr(registry, "_LISTED", 2)
    sessions = sorted([SESSION, *OTHERS])
    known = registry.Registry(five)
    for _ in range(3):
        page, more = known.page("", lambda owner: owner == "")
        assert (names_of(page), more, reads) == (sessions[:2], True, sessions[:2])
    page, more = known.page(sessions[3], lambda owner: True)
    assert (names_of(page), more) == (sessions[4:], False)
    assert known.page("", lambda owner: owner != "") == ([], False)
    assert reads == [*sessions[:2], sessions[4]]


def test_changed_sessions_are_read_again(five: SessionStore, reads: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(listing, "_SETTLED_SECONDS", -1.0)
    driver = driver_at_rest(five, "f" * 32)
    assert [found.step for found in five.sessions()] == [1] * 6
    driver = resume_driver(driver, five)
    advance(driver, 2)
    driver.host.close()
    five.discard(OTHERS[1])
    reads.clear()
    expected = {name: 1 for name in (SESSION, *OTHERS) if name != OTHERS[1]} | {"f" * 32: 3}
    assert {found.session: found.step for found in five.sessions()} == expected
    assert reads == ["f" * 32]


def change(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[-3] ^= 4
    path.write_bytes(content)


CUTS = [lambda path, n=n: os.truncate(path, n % path.stat().st_size) for n in (0, 7, 100, -1)]


@pytest.mark.parametrize("name", ["mesh.bin", "slot-1"])
@pytest.mark.parametrize("damage", [Path.unlink, change, *CUTS])
def test_a_session_that_resume_would_refuse_is_not_ready(five: SessionStore, name: str, damage: Any) -> None:
    damage(five.root / "sessions" / SESSION / name)
    states = {found.session: found.state for found in five.sessions()}
    assert states == dict.fromkeys(OTHERS, "READY") | {SESSION: "FAILED"}


def test_a_state_that_is_replaced_while_it_is_read_is_no_damage(five: SessionStore, reads: list[str]) -> None:
    driver = resume_driver(driver_at_rest(five, "f" * 32), five)
    folder = five.root / "sessions" / ("f" * 32)
    listed = listing.Listing(PosixFileSystem())
    before = read_ledger(folder, PosixFileSystem())
    advance(driver, 2)  # into the same slot
    listed._require_files(folder, before)
    driver.host.close()


def test_of_large_meshes_a_list_reads_heads_only(journal: Any) -> None:
    _, files, folder = journal
    before = files.read_bytes
    mesh = folder / "mesh.bin"
    assert verifies(mesh, files, b"", len(files.entries[mesh].cache) - 1)
    assert files.read_bytes - before < 200 < len(files.entries[folder / "mesh.bin"].cache)


def test_sessions_that_changed_within_a_tick_are_not_remembered(five: SessionStore, reads: list[str]) -> None:
    """Within one tick of a file system's clock two changes have the same time."""
    five.sessions()
    five.sessions()
    assert len(reads) == 10


def test_no_more_is_remembered_than_may_be(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(listing, "_SETTLED_SECONDS", -1.0)
    remembered: Any = listing.Remembered(2)
    paths = [tmp_path / name for name in "abc"]
    reads: list[Path] = []
    for path in paths:
        path.write_bytes(b"")
    for path in (*paths, paths[2], paths[1], paths[0], tmp_path / "missing", tmp_path / "missing"):
        remembered.get(path, lambda path=path: reads.append(path))
    assert [path.name for path in reads] == ["a", "b", "c", "a", "missing", "missing"]
