"""Servers with faults in their processes."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

SEEDED = Path(__file__).parent / "seeded"


@pytest.fixture
def seed(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Faults by name (tests/proofs/seeded/sitecustomize.py) for all servers that are started from now on."""

    def seed(*names: str) -> None:
        paths = [str(SEEDED), *filter(None, [os.environ.get("PYTHONPATH")])]
        monkeypatch.setenv("PYTHONPATH", os.pathsep.join(paths))
        monkeypatch.setenv("SEEDED_FAULTS", ",".join(names))

    return seed
