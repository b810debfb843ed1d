"""The builders of the session's tests, which these share."""

import importlib.util
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from mesh_motion_server.session.store import SessionStore

_SPEC = importlib.util.spec_from_file_location(
    "mesh_motion_tests_session", Path(__file__).parents[1] / "session" / "conftest.py"
)
assert _SPEC is not None
assert _SPEC.loader is not None
_MODULE = importlib.util.module_from_spec(_SPEC)
sys.modules["mesh_motion_tests_session"] = _MODULE
_SPEC.loader.exec_module(_MODULE)

kit = _MODULE.kit


@pytest.fixture
def store(tmp_path: Path) -> SessionStore:
    """An empty store."""
    return SessionStore(tmp_path)


@pytest.fixture
def driver(kit: SimpleNamespace, store: SessionStore) -> Any:
    """One partition, NEW."""
    return kit.make_driver(store, [kit.grid_mesh()])


@pytest.fixture
def ready(driver: Any) -> Any:
    """One partition, READY at step 0."""
    driver.open()
    return driver
