"""Runs and meshes of stored sessions."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from histories import lowest_quality, write_history
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.session.store import SessionStore
from mesh_motion_server.watch.pictures.meshes import read_pair
from mesh_motion_server.watch.pictures.runs import read_runs
from tests.faults.driver import Driver, make_driver
from tests.faults.stand_in import grid_mesh


@pytest.fixture
def driver(tmp_path: Path) -> Driver:
    driver = make_driver(SessionStore(tmp_path), [grid_mesh()], spec={"label": "flap\x1b"})
    driver.open()
    return driver


def folder_of(tmp_path: Path) -> Path:
    (folder,) = (tmp_path / "sessions").iterdir()
    return folder


def made_up(tmp_path: Path, steps: int) -> Path:
    folder = folder_of(tmp_path)
    shutil.rmtree(folder / "history")
    write_history(folder, steps)
    return folder


def test_a_history_is_a_run(driver: Driver, tmp_path: Path) -> None:
    driver.host.close()
    (run,) = read_runs([made_up(tmp_path, 200)])
    assert (run.label, run.metric, run.threshold) == ("flap�", "size-skew", 0.2)
    assert list(run.step) == list(range(1, 201))
    lowest = np.array([lowest_quality(step) for step in run.step])
    np.testing.assert_allclose(run.columns["standard_min"], lowest)
    np.testing.assert_allclose(run.columns["actual_min"], np.maximum(lowest, 0.205))
    assert (run.columns["actual_p5"] > run.columns["actual_p1"]).all()
    assert run.refused == (97, 194)
    assert run.columns["iterations"].max() == 3


def test_another_metric_has_its_own_numbers_and_no_threshold(driver: Driver, tmp_path: Path) -> None:
    driver.host.close()
    (run,) = read_runs([made_up(tmp_path, 20)], "skew")
    assert (run.metric, run.threshold) == ("skew", None)
    assert np.isfinite(run.columns["actual_min"]).all()
    assert np.isfinite(run.columns["predicted_min"]).all()


def test_a_session_without_steps_says_so(driver: Driver, tmp_path: Path) -> None:
    driver.host.close()
    with pytest.raises(InvalidInput, match="its history has no committed step"):
        read_runs([folder_of(tmp_path)])


def test_the_stored_mesh_before_and_after(driver: Driver, tmp_path: Path) -> None:
    driver.advance(1)
    driver.advance(2)
    folder = folder_of(tmp_path)
    pair = read_pair(folder)
    assert (pair.label, pair.metric, pair.before.step, pair.after.step) == ("flap�", "relative-size-skew", 0, 2)
    assert len(pair.before.points) == len(pair.after.points)
    assert np.abs(pair.after.points - pair.before.points).max() > 0
    assert set(pair.after.moving) <= set(range(len(pair.before.points)))
    with pytest.raises(InvalidInput, match="as uploaded and after step 2 only, got 1:"):
        read_pair(folder, first=1)
    driver.host.close()
