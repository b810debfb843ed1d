"""Several threads that use one session or one server: their requests follow one another."""

import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from mesh_motion_client import Timeout

UP = np.array([[0.0, 0.25]] * 4)


def test_the_requests_of_several_threads_follow_one_another(client, session):
    with ThreadPoolExecutor(8) as threads:
        moves = [threads.submit(session.move, UP * share, timeout=30) for share in np.linspace(0.1, 1.0, 16)]
        lists = [threads.submit(client.sessions) for _ in range(16)]
    iterations = sorted(move.result().iteration for move in moves)
    assert len(set(iterations)) == len(moves)
    assert {found.result()[0]["worker"] for found in lists} == {"alive"}
    session.move(UP)
    assert session.commit().step == 1


def test_a_thread_waits_for_another_no_longer_than_its_own_time(session):
    taken, free = threading.Event(), threading.Event()

    def hold():
        with session._courier._turn:
            taken.set()
            free.wait(30)

    with ThreadPoolExecutor(1) as threads:
        threads.submit(hold)
        taken.wait(30)
        with pytest.raises(Timeout, match="another thread's request"):
            session.move(UP, timeout=0.2)
        free.set()
    session.move(UP)
