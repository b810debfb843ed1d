"""What lists read of a journal: as much as is used, and the same as from the whole."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from mesh_motion_protocol.messages import Commit, Move

from mesh_motion_server.prove.driver import SESSION, make_driver
from mesh_motion_server.prove.model_files import ModelFiles
from mesh_motion_server.prove.stand_in import grid_mesh
from mesh_motion_server.session.journal_files import MANIFEST, read_ledger
from mesh_motion_server.session.recovery import read_chain, sum_up
from mesh_motion_server.session.store import SessionStore


class CountingFiles(ModelFiles):
    """How many bytes were read."""

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
