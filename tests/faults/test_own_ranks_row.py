"""The row of ranks that correct their own nodes: a seed, and a client that forgets the correction is found."""

import pytest
from mesh_motion_client import Session, volume
from mesh_motion_client.courier import Courier

from tests.faults import own_ranks
from tests.faults.check import BrokenPromise, Budget
from tests.faults.network_faults import loopback
from tests.faults.own_ranks import Rank, undisturbed
from tests.faults.server_process import ServerProcess


@pytest.fixture(scope="module")
def expected():
    return undisturbed()


@pytest.fixture
def rank(tmp_path, expected, monkeypatch):
    ports = own_ranks._PORTS
    settings = {"advertised_host": "0.0.0.0", "data_ports": f"{ports[0]}-{ports[-1]}", "max_sessions": len(ports) - 2}
    with ServerProcess(tmp_path, endpoint=f"tcp://{loopback()}:{ports[0] - 1}", **settings) as server:
        made = Rank(server, expected)
        yield made
        monkeypatch.undo()
        made.close()


@pytest.mark.nightly
def test_some_seeds():
    assert own_ranks.run(1, Budget(3)).passed


@pytest.fixture
def killed_before_commit(rank, monkeypatch):
    """The server is killed once, when the trial is corrected and judged."""
    commit, kills = Session.commit, iter([rank.restart])

    def after_a_kill(session, **options):
        next(kills, lambda: None)()
        return commit(session, **options)

    monkeypatch.setattr(Session, "commit", after_a_kill)


def test_a_server_killed_before_the_commit_corrects_the_trial_again(rank, killed_before_commit):
    rank._step()
    rank._resume()
    rank._step()
    assert not rank.errors


def test_a_client_that_does_not_correct_a_lost_trial_again_is_found(rank, killed_before_commit, monkeypatch):
    repeat = Courier._repeat_trial

    def forgetful(self, deadline):
        self.trial = tuple(request for request in self.trial if request.type != "CORRECT")
        return repeat(self, deadline)

    monkeypatch.setattr(Courier, "_repeat_trial", forgetful)
    with pytest.raises(BrokenPromise, match=r"the coordinates of step 1 are others|MOVE and COMMIT raised"):
        rank._step()


def test_a_client_that_resumes_without_the_correction_is_found(rank, monkeypatch):
    monkeypatch.setattr(volume.Volume, "_here", lambda self, ids: (ids[:0], ids[:0]))
    with pytest.raises(BrokenPromise, match="step 1 is another one"):
        rank._step()
