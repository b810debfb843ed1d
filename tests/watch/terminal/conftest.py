"""State folders with sessions whose histories are made up."""

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from histories import write_history

from mesh_motion_server.session.store import SessionStore
from tests.faults.driver import Driver, make_driver
from tests.faults.stand_in import grid_mesh

MakeSession = Callable[..., Path]


@pytest.fixture
def make_session(tmp_path: Path) -> Iterator[MakeSession]:
    """Make a session in tmp_path / "state": its label, steps, whether its process lives; returns its folder."""
    drivers: list[Driver] = []

    def make(label: str = "flap", steps: int = 30, *, live: bool = True, **options: Any) -> Path:
        name = f"{len(drivers) + 0xA1:02x}" * 16
        driver = make_driver(SessionStore(tmp_path / "state"), [grid_mesh()], session=name, spec={"label": label})
        driver.open()
        drivers.append(driver)
        folder = tmp_path / "state" / "sessions" / name
        shutil.rmtree(folder / "history")
        write_history(folder, steps, **options)
        if not live:
            driver.host.close()
        return folder

    yield make
    for driver in drivers:
        driver.host.close()
