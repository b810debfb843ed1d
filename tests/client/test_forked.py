"""A forked child of a client: it has the parent's sockets, but none of the threads that serve them."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from mesh_motion_client import SessionError, connect

from tests.faults.processes import alive
from tests.faults.waiting import wait_until

UP = np.array([[0.0, 0.25]] * 4)


def in_child(work):
    """Run ``work`` in a forked child; its exit status, 0 if nothing was raised."""
    child = os.fork()
    if not child:
        try:
            work()
        except BaseException:
            sys.excepthook(*sys.exc_info())
            os._exit(1)
        os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def test_a_child_is_refused_at_once_and_leaves_the_session_to_its_parent(client, session):
    session.move(UP)

    def work():
        calls = [lambda: session.move(UP), session.commit, session.points, session.close, client.sessions]
        for call in calls:
            with pytest.raises(SessionError, match=rf"a forked child .* \(process {os.getppid()}\).*server.resume"):
                call()
        session._courier.disconnect()
        client.close()

    assert in_child(work) == 0
    assert session.commit().step == 1
    assert client.sessions()[0]["worker"] == "alive"


def test_a_child_may_take_the_session_up_by_a_connection_of_its_own(server, client, session):
    session.move(UP)
    session.commit()

    def work():
        with connect(server.endpoint) as own, own.resume(session.credentials) as taken_up:
            taken_up.move(UP)
            assert taken_up.commit().step == 2

    assert in_child(work) == 0
    with client.resume(session.credentials) as taken_back:
        assert taken_back.step == 2


PROGRAM = """
import os, sys
from mesh_motion_client import connect
server = connect()
child = os.fork()
if not child:
    server.close()
    sys.exit()  # with all that an interpreter does at its end
assert os.waitpid(child, 0)[1] == 0
assert server.sessions() == []
child = os.fork()
if not child:
    os.read(0, 1)  # lives on
    os._exit(0)
print(server.endpoint, server._embedded.process.pid, flush=True)
os.kill(os.getpid(), 9)
"""


def test_a_private_server_belongs_to_the_parent():
    """Neither ``close`` nor the end of a child stops the server or removes its folders; a child does not keep it
    alive.
    """
    with subprocess.Popen(
        [sys.executable, "-c", PROGRAM], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as program:
        endpoint, pid = program.stdout.readline().split()
        wait_until(lambda: not alive(int(pid)), "the server has ended with its client")
    assert not Path(endpoint.removeprefix("ipc://")).parent.exists()
