"""The power-loss row: a seed repeats it, and its failure names the place."""

from typing import Any

import pytest
from mesh_motion_protocol.errors import DataLoss

from mesh_motion_server.session.journal.journal import Journal
from tests.faults.check import BrokenPromise, Budget
from tests.faults.power_loss import CHECK


def test_a_few_lives() -> None:
    first, again = (CHECK.run(2, Budget(300)) for _ in range(2))
    assert first.passed
    assert first == again
    assert first.details["disks"] >= 300
    assert first.details["disks"] != CHECK.run(3, Budget(300)).details["disks"]


def test_a_broken_promise_says_in_which_life(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Journal, "_write_slot", lambda self, *arguments: None)
    with pytest.raises((BrokenPromise, DataLoss)) as caught:
        CHECK.run(2, Budget(300))
    notes: Any = " ".join(caught.value.__notes__)
    assert "life 0, level full, script " in notes
    assert "power lost before operation" in notes
