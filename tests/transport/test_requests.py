"""One server, its control endpoint and its workers: requests over real sockets, right and wrong ones."""

import numpy as np
import pytest
from mesh_motion_protocol.messages import Commit, Move, Probe

ONES = np.ones((2, 2))


@pytest.fixture
def server(lasting_server):
    (lasting_server.state / "go").unlink(missing_ok=True)
    return lasting_server


def test_probe_answers_while_the_worker_computes(server, connect, open_moving):
    opened, data = open_moving(server)
    probed = connect(server.endpoint).ask(Probe, session=opened.session, token=opened.token)
    assert (probed.worker, probed.epoch, probed.endpoint) == ("alive", 1, opened.endpoint)
    (server.state / "go").touch()
    assert data.receive().type == "MOVED"


def test_a_reply_that_cannot_be_encoded_is_an_error_and_not_the_end(server, open_session):
    _, data, at = open_session(server, label="bad-reply")
    assert data.ask(Move, **at, step=1, frame="reference", displacement=ONES).code == "INTERNAL"
    assert data.ask(Commit, **at, step=1).type == "COMMITTED"
