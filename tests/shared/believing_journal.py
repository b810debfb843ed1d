"""A seeded bug: a journal that accepts the content of a slot as a state, without checking checksum and digest."""

from typing import Any

import numpy as np
import pytest

from mesh_motion_server.session.journal import files as journal_files
from mesh_motion_server.session.journal import journal as journal_module


def believe_every_slot(monkeypatch: pytest.MonkeyPatch) -> None:
    honest = journal_files.view_slot

    def believe(path: Any, files: Any, foundation: Any) -> Any:
        view = honest(path, files, foundation)
        return journal_files.SlotView(view.record, view.blank, lambda: True)

    monkeypatch.setattr(journal_files, "view_slot", believe)
    monkeypatch.setattr(
        journal_module,
        "verified_state",
        lambda raw, ledger: np.frombuffer(raw, "<f8").reshape(ledger.foundation.nodes, ledger.foundation.dimension),
    )
