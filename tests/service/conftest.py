"""A session without a socket: new, and ready to move."""

from pathlib import Path
from typing import Any

import pytest

from mesh_motion_server.session.store import SessionStore
from tests.faults.driver import make_driver
from tests.faults.stand_in import grid_mesh


@pytest.fixture
def store(tmp_path: Path) -> SessionStore:
    """An empty store."""
    return SessionStore(tmp_path)


@pytest.fixture
def driver(store: SessionStore) -> Any:
    """One partition, NEW."""
    return make_driver(store, [grid_mesh()])


@pytest.fixture
def ready(driver: Any) -> Any:
    """One partition, READY at step 0."""
    driver.open()
    return driver
