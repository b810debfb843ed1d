"""Inspection: it reports and verifies all data, and changes no byte."""

import json
from dataclasses import asdict
from pathlib import Path

import pytest
from mesh_motion_protocol.errors import DataLoss

from mesh_motion_server.session.inspection import inspect_session
from mesh_motion_server.session.journal.records import PAGE
from mesh_motion_server.session.store import SessionStore
from tests.faults.driver import SESSION, TOKEN, make_driver
from tests.faults.stand_in import grid_mesh


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    store = SessionStore(tmp_path)
    driver = make_driver(store, [grid_mesh()], spec={"label": "wing"})
    driver.open()
    driver.advance(1)
    driver.host.reclaim(TOKEN)
    driver.join()
    (committed,) = driver.advance(2)
    (tmp_path / "digest").write_text(committed.digest.hex())
    driver.host.close()
    return tmp_path / "sessions" / SESSION


def test_a_whole_session(folder: Path) -> None:
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    found = inspect_session(folder)
    assert (found.state, found.step, found.epoch, found.label, found.nodes) == ("whole", 2, 2, "wing", 25)
    assert [check.name for check in found.checks if check.passed] == ["journal", "spec", "mesh", "state"]
    assert found.digest == (folder.parents[1] / "digest").read_text()
    assert found.settings["correction"] == "smooth"
    json.dumps(asdict(found))
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before


def test_a_torn_tail_is_unfinished(folder: Path) -> None:
    data = bytearray((folder / "manifest").read_bytes())
    data[3 * PAGE + 100 : 4 * PAGE] = bytes(PAGE - 100)
    (folder / "manifest").write_bytes(data)
    found = inspect_session(folder)
    assert (found.state, found.step) == ("unfinished", 2)
    assert (folder / "manifest").read_bytes() == bytes(data)


@pytest.mark.parametrize(
    ("name", "offset", "failing"),
    [("slot-0", -1, "state"), ("mesh.bin", -1, "mesh"), ("spec.json", 5, "spec"), ("manifest", PAGE + 70, "journal")],
)
def test_kinds_of_damage_are_distinguished(folder: Path, name: str, offset: int, failing: str) -> None:
    data = bytearray((folder / name).read_bytes())
    data[offset] ^= 1
    (folder / name).write_bytes(data)
    if name == "spec.json":
        data[offset] ^= 1
        (folder / name).write_bytes(data + b" ")
    found = inspect_session(folder)
    assert found.state == "damaged"
    assert [check.name for check in found.checks if not check.passed] == [failing]


def test_a_session_without_its_manifest_and_a_folder_that_is_none(folder: Path, tmp_path: Path) -> None:
    (folder / "manifest").unlink()
    assert inspect_session(folder).state == "damaged"
    with pytest.raises(DataLoss, match="is not a session's folder"):
        inspect_session(tmp_path)


def test_a_missing_slot_is_reported(folder: Path) -> None:
    (folder / "slot-1").unlink()
    found = inspect_session(folder)
    assert found.state == "damaged"
    assert "cannot be read" in found.checks[0].message
