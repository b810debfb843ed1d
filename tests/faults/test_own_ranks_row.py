"""The row of ranks that correct their own nodes: a seed, and detection of a client that forgets the correction."""

import pytest
from mesh_motion_client import Session, volume
from mesh_motion_client.courier import Courier

from tests.faults import network_driver, own_ranks
from tests.faults.check import BrokenPromise
from tests.faults.network_faults import restarter


@pytest.fixture(scope="module")
def whole():
    return own_ranks.WholeMesh()


@pytest.fixture
def driver(tmp_path, whole, monkeypatch):
    monkeypatch.setattr(network_driver, "SLACK", 200.0)  # a server is killed and started again within a call
    with own_ranks.rank(tmp_path, whole) as lane:
        lane.driver.restart = restarter(lane.server)
        yield lane.driver
        monkeypatch.undo()


@pytest.fixture
def killed_before_commit(driver, monkeypatch):
    """The server is killed once, when the trial is corrected and judged."""
    commit, kills = Session.commit, iter([driver.restart])

    def after_a_kill(session, **options):
        next(kills, lambda: None)()
        return commit(session, **options)

    monkeypatch.setattr(Session, "commit", after_a_kill)


def test_a_server_killed_before_the_commit_corrects_the_trial_again(driver, killed_before_commit):
    driver.step()
    driver.check_points()
    driver.resume()
    driver.step()
    assert not driver.errors


def test_a_client_that_does_not_correct_a_lost_trial_again_is_found(driver, killed_before_commit, monkeypatch):
    repeat = Courier._repeat_trial

    def forgetful(self, deadline):
        self.trial = tuple(request for request in self.trial if request.type != "CORRECT")
        return repeat(self, deadline)

    monkeypatch.setattr(Courier, "_repeat_trial", forgetful)
    with pytest.raises(BrokenPromise, match=r"the coordinates of step 1 differ|COMMIT raised"):
        _step_and_look(driver)


def test_a_client_that_resumes_without_the_correction_is_found(driver, monkeypatch):
    monkeypatch.setattr(volume.Volume, "_here", lambda self, ids: (ids[:0], ids[:0]))
    with pytest.raises(BrokenPromise, match="MOVED 1 of step 1 is another array"):
        driver.step()


def _step_and_look(driver):
    driver.step()
    driver.check_points()
