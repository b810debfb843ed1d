"""A client with keys, and one without or with wrong ones, at the real session host."""

import os
import signal

import numpy as np
import pytest
from mesh_motion_client import SessionError, Unavailable, connect

HINTS = np.full((4, 2), 0.125)
SECONDS = 30.0


@pytest.fixture
def alice(keyed_server):
    with connect(keyed_server.endpoint, timeout=SECONDS, keys=keyed_server.alice) as server:
        yield server


def test_a_session_from_open_to_resume_with_keys(keyed_server, alice, mesh):
    with alice.open(mesh, {"support_radius": 1.0}) as session:
        session.move(HINTS)
        session.commit()
        os.kill(keyed_server.worker_of(session.credentials.session), signal.SIGKILL)
        moved = session.move(HINTS)  # found again, resumed and joined with the same keys
        assert moved.step == 2
        session.commit()
    with alice.resume(session.credentials) as again:
        assert again.step == 2


def test_a_key_that_is_not_admitted_gets_an_error_at_once(keyed_server):
    with pytest.raises(SessionError, match="does not admit this key") as error:
        connect(keyed_server.endpoint, timeout=SECONDS, keys=keyed_server.mallory)
    assert error.value.code == "UNAUTHENTICATED"


def test_a_client_without_keys_is_asked_to_give_some(keyed_server):
    with pytest.raises((SessionError, Unavailable), match=r"keys|--keys"):
        connect(keyed_server.endpoint, timeout=SECONDS)


def test_a_client_with_keys_learns_that_the_server_has_none(lasting_server, keyed_server):
    with pytest.raises((SessionError, Unavailable), match="key"):
        connect(lasting_server.endpoint, timeout=SECONDS, keys=keyed_server.alice)
