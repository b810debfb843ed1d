"""The row of isolation: its verdict, its verdict on servers that are not isolated, and one run of the row."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from tests.faults import isolation
from tests.faults.check import BrokenPromise
from tests.faults.isolation import Neighbour, Pings, judge, measured

QUICK = {"control": 0.001, "data": 0.001, "echo": 0.001}


@pytest.mark.parametrize(
    ("busy", "growth", "kept"),
    [
        (QUICK, 0, True),
        (QUICK | {"control": 0.0179}, 0, True),
        (QUICK | {"control": 0.0181}, 0, False),
        (QUICK | {"data": 0.0181}, 0, False),
        ({"control": 0.040, "data": 0.030, "echo": 0.010}, 0, True),
        (QUICK, 33 << 20, False),
    ],
)
def test_judgement(busy: dict[str, float], growth: int, kept: bool) -> None:
    assert judge({"idle": QUICK, "busy": busy}, growth) is kept


#: A server of one process, which does its own syncing, or another's upload, between two answers.
_ONE_PROCESS = """
import time, zmq
socket = zmq.Context().socket(zmq.ROUTER)
socket.sndtimeo = socket.rcvtimeo = 600_000
socket.linger = 0
print(socket.bind("tcp://127.0.0.1:*").addr, flush=True)
number = 0
while True:
    socket.send_multipart(socket.recv_multipart())
    number += 1
    if number % 20 == 0:
        time.sleep(1)
"""


@contextmanager
def process(program: str) -> Iterator[str]:
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True) as running:
        yield running.stdout.readline().strip()
        running.kill()


def test_a_server_that_computes_where_it_answers_is_found() -> None:
    with process(_ONE_PROCESS) as slow, process(isolation._ECHO) as echo:
        pings = Pings({"control": slow, "data": echo, "echo": echo})
        times = measured(pings, [], 100, lambda: None)
        pings.close()
    p99 = {name: float(np.percentile(values, 99)) for name, values in times.items()}
    assert not judge({"busy": p99}, 0)


def test_a_server_that_falls_with_its_neighbour_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(isolation, "_PATIENCE", 0.2)
    pings = Pings({"control": "tcp://127.0.0.1:9"})
    with pytest.raises(BrokenPromise, match="no answer to a PING from control"):
        pings.ask()
    pings.close()


def test_neighbours_that_do_no_harm_are_found() -> None:
    neighbour = Neighbour("upload", "tcp://nowhere")
    try:
        with pytest.raises(BrokenPromise, match="'upload' has ended by itself"):
            measured(NoPings(), [neighbour], 0, lambda: None)
    finally:
        neighbour.close()


class NoPings:
    def ask(self) -> dict[str, float]:
        return {}
