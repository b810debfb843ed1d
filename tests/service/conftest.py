"""A session without a socket: new, and ready to move."""

from pathlib import Path
from typing import Any

import pytest

from mesh_motion_server.session.store import SessionStore
from tests.faults.driver import make_driver
from tests.faults.stand_in import grid_mesh


@pytest.fixture
def store(tmp_path: Path) -> SessionStore:
    return SessionStore(tmp_path)


@pytest.fixture
def driver(store: SessionStore) -> Any:
    return make_driver(store, [grid_mesh()])


@pytest.fixture
def ready(driver: Any) -> Any:
    driver.open()
    return driver
