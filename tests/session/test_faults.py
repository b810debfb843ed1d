"""A disk that fails at any operation: the campaign of `python -m tests.faults`, and seeded bugs that it must find."""

import errno
from contextlib import suppress
from typing import Any

import pytest
from mesh_motion_protocol.errors import DataLoss, MeshMotionError

from mesh_motion_server.session.journal.journal import Journal
from mesh_motion_server.session.journal.relaxed import RelaxedKeeper
from tests.faults.check import BrokenPromise
from tests.faults.io_faults import fail_each_call, short_writes


def test_failures_of_what_is_written_ahead(monkeypatch: pytest.MonkeyPatch) -> None:
    """The mesh is written while it is checked, and states are synced before their commit."""
    before = fail_each_call(errno.ENOSPC, for_ever=True)
    monkeypatch.setattr("mesh_motion_server.session.store._LARGE_MESH", 0)
    assert fail_each_call(errno.ENOSPC, for_ever=True) == before
    monkeypatch.setattr("mesh_motion_server.session.journal.journal._LARGE_STATE", 0)
    assert fail_each_call(errno.ENOSPC, for_ever=True)["FROZEN"] > before["FROZEN"]  # one more sync in each commit


def test_failures_behind_the_back_of_a_commit() -> None:
    endings = fail_each_call(errno.ENOSPC, for_ever=True, level="relaxed")
    assert endings.pop("whole") == 1
    assert set(endings) == {"not created", "not built", "FROZEN"}
    assert endings["FROZEN"] > 20


@pytest.mark.parametrize(("most", "level"), [(1, "full"), (7, "replay"), (1000, "relaxed")])
def test_short_writes_are_continued(most: int, level: str) -> None:
    short_writes(most, level)


# --- tests of the test: each seeded bug must be found ----------------------------------------------------------------


def test_a_journal_that_does_not_freeze_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Journal, "_require_usable", lambda self: None)
    monkeypatch.setattr(Journal, "frozen", property(lambda self: False, lambda self, value: None), raising=False)
    with pytest.raises((BrokenPromise, MeshMotionError)):
        fail_each_call(errno.EIO, for_ever=False)


def test_an_error_that_is_swallowed_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    honest = Journal._write_slot

    def swallowing(self: Journal, step: int, packed: bytes, state: Any) -> None:
        with suppress(OSError):
            honest(self, step, packed, state)

    monkeypatch.setattr(Journal, "_write_slot", swallowing)
    with pytest.raises((BrokenPromise, MeshMotionError)):
        fail_each_call(errno.ENOSPC, for_ever=False)


def test_a_failure_in_the_background_that_is_not_reported_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tests.faults.io_faults._PATIENCE", 0.5)
    monkeypatch.setattr(RelaxedKeeper, "frozen", False)
    with pytest.raises(BrokenPromise, match="step 1 does not become durable"):
        fail_each_call(errno.EIO, for_ever=False, level="relaxed")


def test_a_write_that_is_not_continued_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    def once(files: Any, handle: int, offset: int, data: Any) -> int:
        return offset + int(files.write(handle, offset, data))

    monkeypatch.setattr("mesh_motion_server.session.journal.journal.write_all", once)
    with pytest.raises((BrokenPromise, DataLoss)):
        short_writes(100)
