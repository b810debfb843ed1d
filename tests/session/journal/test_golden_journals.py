"""Journals of earlier versions are opened bitwise, and this version writes exactly the stored files of its format.

If a test fails here after a change of the format, raise the format number and add a golden journal, see
``tests/references/journals/build_journals.py``; the stored ones stay as they are.
"""

import hashlib
import json
import zipfile
from pathlib import Path
from typing import Any

import pytest
from loaded_scripts import loaded
from mesh_motion_protocol.codec import encode
from mesh_motion_protocol.errors import DataLoss

from mesh_motion_server.session.inspection import inspect_session
from mesh_motion_server.session.journal import journal as journal_module
from mesh_motion_server.session.journal.files import read_journal
from mesh_motion_server.session.journal.filesystem import PosixFileSystem
from mesh_motion_server.session.journal.ledger import Commit
from mesh_motion_server.session.journal.records import FORMATS, pack_record, unpack_record
from mesh_motion_server.session.store import SessionStore
from tests.faults.driver import SESSION, TOKEN, Driver
from tests.faults.stand_in import grid_mesh

GOLDEN = Path(__file__).parents[2] / "references" / "journals"
STORED = sorted(str(path.relative_to(GOLDEN).with_suffix("")) for path in GOLDEN.glob("*/*.zip"))


@pytest.fixture(scope="module")
def builder() -> Any:
    return loaded(GOLDEN / "build_journals.py")


@pytest.fixture(autouse=True)
def capacity(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(journal_module, "manifest_capacity", journal_module.manifest_capacity)


def unpacked(name: str, root: Path, session: str) -> dict[str, Any]:
    """Unpack a golden journal into a state folder; return its expected data."""
    folder = root / "sessions" / session
    folder.mkdir(parents=True)
    with zipfile.ZipFile(GOLDEN / f"{name}.zip") as archive:
        archive.extractall(folder)
    expected: dict[str, Any] = json.loads((folder / "expected.json").read_bytes())
    (folder / "expected.json").unlink()
    return expected


def test_every_format_and_level_has_its_journal(builder: Any) -> None:
    assert set(STORED) >= {f"{number}/{level}" for level, number in builder.FORMATS.items()}
    assert {int(name.partition("/")[0]) for name in STORED} == set(FORMATS)


@pytest.mark.parametrize("name", STORED)
def test_it_is_opened_bitwise(name: str, builder: Any, tmp_path: Path) -> None:
    expected = unpacked(name, tmp_path, SESSION)
    driver, said = builder.taken_up(tmp_path)
    assert (driver.host.step, driver.host.epoch) == (expected["step"], expected["epoch"] + 1)
    assert said == {key: expected[key] for key in said}
    digests = {str(commit.step): commit.digest.hex() for commit in driver.host._session.commits}
    assert digests == expected["digests"]
    for step, frame in expected["replies"].items():
        (reply,) = driver.send(builder.requests(driver, int(step)))
        assert b"".join(bytes(part) for part in encode(reply)).hex() == frame
    driver.host.close()


@pytest.mark.parametrize("name", STORED)
def test_it_is_whole_and_goes_on(name: str, builder: Any, tmp_path: Path) -> None:
    unpacked(name, tmp_path, SESSION)
    folder = tmp_path / "sessions" / SESSION
    found = inspect_session(folder)
    assert (found.state, found.step, found.stored_step) == ("whole", 5, 3 if name.endswith("replay") else 5)
    host = Driver(_resume(builder, tmp_path), [grid_mesh(4)])
    host.sequences = [2000]
    host.join()
    for step in range(6, 30):
        host.advance(step)
    host.host.close()
    assert inspect_session(folder).step == 29
    assert _resume(builder, tmp_path).step == 29


def _resume(builder: Any, root: Path) -> Any:
    from mesh_motion_server.service.dispatch import SessionHost  # noqa: PLC0415

    return SessionHost.resume(SESSION, TOKEN, SessionStore(root), build_model=builder.MODEL)


# --- what this version writes ----------------------------------------------------------------------------------------


def differences(name: str, builder: Any, session: str, root: Path) -> list[str]:
    """Differences between a newly built journal and the golden one, without settings that were added since."""
    unpacked(name, root / "golden", session)
    builder.build(name.partition("/")[2], root / "fresh")
    golden, fresh = (root / which / "sessions" / session for which in ("golden", "fresh"))
    found = [] if (golden / "mesh.bin").read_bytes() == (fresh / "mesh.bin").read_bytes() else ["mesh.bin"]
    found += _spec_differences(golden, fresh)
    here, there = (read_journal(folder, PosixFileSystem()) for folder in (fresh, golden))
    bodies = [
        [record.body | ({"spec": b""} if "spec" in record.body else {}) for record in f.records] for f in (here, there)
    ]
    found += [] if bodies[0] == bodies[1] else ["records"]
    again = b"".join(pack_record(r.sequence, r.previous, r.body, r.format) for r in there.records)
    found += [] if (golden / "manifest").read_bytes().startswith(again) else ["framing"]
    sizes = [[(folder / file).stat().st_size for file in builder.FILES[1:]] for folder in (golden, fresh)]
    found += [] if sizes[0] == sizes[1] else ["sizes"]
    area = there.ledger.foundation.record_area
    for slot in ("slot-0", "slot-1"):
        found += [] if (golden / slot).read_bytes()[area:] == (fresh / slot).read_bytes()[area:] else [slot]
    return found


def _spec_differences(golden: Path, fresh: Path) -> list[str]:
    old, new = (json.loads((folder / "spec.json").read_bytes()) for folder in (golden, fresh))
    settings = {key: new["settings"].get(key) for key in old["settings"]}
    return [] if new | {"settings": settings} == old else ["spec.json"]


@pytest.mark.parametrize("level", ["full", "replay", "relaxed"])
def test_this_version_writes_it_byte_by_byte(level: str, builder: Any, tmp_path: Path) -> None:
    assert differences(f"{builder.FORMATS[level]}/{level}", builder, SESSION, tmp_path) == []


@pytest.mark.parametrize("level", ["full", "replay", "relaxed"])
def test_a_format_that_changes_under_its_number_is_found(
    level: str, builder: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    honest = Commit.as_body
    monkeypatch.setattr(Commit, "as_body", lambda self: honest(self) | {"more": 1})
    assert differences(f"{builder.FORMATS[level]}/{level}", builder, SESSION, tmp_path) == ["records"]


def test_a_slot_that_is_laid_out_otherwise_is_found(
    builder: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mesh_motion_server.session.store.record_area", lambda *given: 24 * 1024)
    assert {"records", "sizes"} <= set(differences("1/full", builder, SESSION, tmp_path))


# --- what a later version would write --------------------------------------------------------------------------------


def _later_manifest(folder: Path) -> None:
    data = bytearray((folder / "manifest").read_bytes())
    data[6] = FORMATS[-1] + 1
    (folder / "manifest").write_bytes(data)


def _later_spec(folder: Path) -> None:
    text = (folder / "spec.json").read_text()
    _write_spec(folder, text.replace('"format": 1', '"format": 2'))


def _later_setting(folder: Path) -> None:
    values = json.loads((folder / "spec.json").read_text())
    values["settings"]["later"] = True
    _write_spec(folder, json.dumps(values))


def _write_spec(folder: Path, text: str) -> None:
    """As the version that wrote it would: the journal's first record has its digest."""
    (folder / "spec.json").write_text(text)
    manifest = (folder / "manifest").read_bytes()
    first = unpack_record(manifest)
    assert first is not None
    packed = pack_record(0, bytes(32), first.body | {"spec": hashlib.sha256(text.encode()).digest()}, 2)
    (folder / "manifest").write_bytes(packed.ljust(len(manifest), b"\0"))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (_later_manifest, r"format 3; this version reads the formats 1 to 2"),
        (_later_spec, "spec has format 2, which this version does not know; it reads format 1"),
        (_later_setting, "spec has the settings later"),
    ],
)
def test_journals_of_a_later_version_are_refused_and_left_unchanged(
    change: Any, says: str, builder: Any, tmp_path: Path
) -> None:
    unpacked("2/replay", tmp_path, SESSION)
    folder = tmp_path / "sessions" / SESSION
    change(folder)
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    with pytest.raises(DataLoss, match=says) as caught:
        _resume(builder, tmp_path)
    assert caught.value.code == "UNIMPLEMENTED.VERSION"
    assert "version of the server that wrote it" in caught.value.hint
    after = {path.name: path.read_bytes() for path in folder.iterdir() if path.name != "lock"}
    assert after == before
