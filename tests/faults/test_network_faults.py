"""The row of network faults: a few seeds, each kind alone, and detection of clients and servers with seeded bugs."""

import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from random import Random
from typing import Any

import pytest
from mesh_motion_client import connection, courier
from mesh_motion_client.connection import Connection
from mesh_motion_client.courier import Courier
from mesh_motion_protocol.codec import encode
from mesh_motion_protocol.errors import error_from
from mesh_motion_protocol.messages import ErrorReply
from raising import raising

from tests.faults import network_driver
from tests.faults.check import BrokenPromise, Budget
from tests.faults.faulty_network import CORRUPTING, KINDS, Fault
from tests.faults.network_faults import Lane, faults_of, lanes, restarter, run_seeds

Seed = Callable[..., None]
#: After the first message of the data connection, which is the first MOVE or its reply.
FIRST, SECOND, THIRD = 0, 1, 2


@pytest.fixture(scope="module")
def bare(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Lane]:
    with lanes(tmp_path_factory.mktemp("bare"), [0]) as (lane,):
        yield lane


@pytest.fixture
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Deadlines that a busy machine meets, for faults that do not test time."""
    monkeypatch.setattr(network_driver, "_QUICK", 20.0)


@pytest.fixture
def lane(bare: Lane, patient: None) -> Iterator[Lane]:
    bare.open()
    bare.driver.errors.clear()
    yield bare
    bare.network.heal()


def strike(lane: Lane, *faults: Fault) -> None:
    lane.network.arm(faults)
    for _ in range(2):
        lane.driver.step()
    lane.driver.check_points()
    assert lane.network.struck == [fault.kind for fault in faults]
    lane.network.heal()
    lane.driver.step()


@pytest.mark.parametrize("way", ["in", "out"])
@pytest.mark.parametrize("kind", sorted({*KINDS} - {"restart"}))
def test_each_kind(bare: Lane, kind: str, way: str) -> None:
    before = bare.driver.acknowledged
    strike(bare, Fault(kind, "data", way, SECOND, 0.4))
    assert bare.driver.acknowledged == before + 3


def test_the_same_seed_makes_the_same_faults() -> None:
    made = [faults_of(Random("seed"), "resume", corrupting=True) for _ in range(2)]
    assert made[0] == made[1]
    kinds = {fault.kind for seed in range(300) for fault in faults_of(Random(seed), "open", corrupting=True)}
    assert kinds == {*KINDS, *CORRUPTING}


def test_without_keys_a_turned_bit_goes_in_unnoticed(lane: Lane) -> None:
    """The reason why this is promised with keys only: the strict check detects it."""
    lane.network.arm([Fault("flip", "data", "in", FIRST, 0.9)])
    with pytest.raises(BrokenPromise, match="MOVED 1 of step 1 is another array"):
        lane.driver.step()
    lane.open()
    lane.network.arm([Fault("flip", "data", "in", FIRST, 0.9)])
    assert lane.driver.step_of_doubt()


def test_a_client_that_takes_a_reply_with_another_id_is_found(lane: Lane, monkeypatch: pytest.MonkeyPatch) -> None:
    def request(self: Any, message: Any, deadline: float, watch: Any = None, memory: Any = None) -> Any:
        self._check_connected()
        self._socket.send_multipart(encode(message), copy=False)
        reply = self._receive(message, deadline, watch, memory)
        if isinstance(reply, ErrorReply):
            raise error_from(reply)
        return reply

    monkeypatch.setattr(Connection, "request", request)
    with pytest.raises(BrokenPromise, match="MOVED 2 of step 1 is another array"):
        strike(lane, Fault("duplicate", "data", "out", FIRST, 0.5))


@pytest.mark.parametrize(
    ("kinds", "unit", "broken"),
    [
        (("MOVE", "COMMIT"), FIRST, "2 moves of step 1 were executed, 1 made"),
        (("COMMIT",), THIRD, r"COMMIT raised FAILED_PRECONDITION\.STEP"),
    ],
)
def test_a_client_that_tries_again_by_a_new_id_is_found(
    lane: Lane, monkeypatch: pytest.MonkeyPatch, kinds: tuple[str, ...], unit: int, broken: str
) -> None:
    good = Courier._request

    def request(self: Any, message: Any, deadline: float) -> Any:
        if message.type in kinds:
            self._sequence += 1
            message = courier.replace(message, sequence=self._sequence)
        return good(self, message, deadline)

    monkeypatch.setattr(Courier, "_request", request)
    with pytest.raises(BrokenPromise, match=broken):
        strike(lane, Fault("cut", "data", "out", unit, 0.5))


def test_a_client_that_ignores_its_deadline_is_found(lane: Lane, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(network_driver, "SLACK", 0.2)
    monkeypatch.setattr(network_driver, "_QUICK", 0.5)
    monkeypatch.setattr(Lane, "run", lambda self, seed: strike(self, Fault("drop", "data", "in", FIRST, 0.0)))
    never = threading.Event()
    monkeypatch.setattr(connection, "seconds_left", lambda deadline: float(not never.is_set()))
    monkeypatch.setattr(Connection, "_check_connected", lambda self: None)
    with pytest.raises(BrokenPromise, match="MOVE has not returned long after its deadline"):
        run_seeds([lane], 1, Budget(1))
    never.set()
    wait_for_lanes()


def wait_for_lanes() -> None:
    """A call that did not return in time returns when it can."""
    for thread in threading.enumerate():
        if thread.name.startswith("seeds of"):
            thread.join(30)
            assert not thread.is_alive()


def test_an_error_of_another_type_is_found(lane: Lane, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Connection, "_check_connected", raising(OSError("seeded")))
    with pytest.raises(BrokenPromise, match="MOVE raised OSError: seeded"):
        lane.driver.step()


def test_a_server_that_executes_a_duplicate_is_found(seed: Seed, tmp_path: Path, patient: None) -> None:
    seed("requests that are executed twice")
    with lanes(tmp_path, [0]) as (lane,), pytest.raises(BrokenPromise, match="2 moves of step 1 were executed"):
        strike(lane, Fault("cut", "data", "out", FIRST, 0.5))


@pytest.mark.nightly
def test_a_resume_that_accepts_an_older_step_is_found(seed: Seed, tmp_path: Path, patient: None) -> None:
    seed("a resume at an older step")
    with lanes(tmp_path, [0]) as (lane,):
        for _ in range(2):
            lane.driver.step()
            restarter(lane.server)()
            if lane.driver.acknowledged == 1:
                lane.driver.resume()
        with pytest.raises(BrokenPromise, match="resumed at step 1, 2 was acknowledged"):
            lane.driver.resume()


@pytest.mark.nightly
def test_with_keys_no_changed_byte_goes_in(tmp_path: Path) -> None:
    """Any byte of any unit, also of the handshake."""
    with lanes(tmp_path, [1]) as (lane,):
        rng = Random("changed")
        for number in range(16):
            way = ("in", "out")[number % 2]
            lane.network.arm([Fault(CORRUPTING[number // 2 % 2], "data", way, rng.randrange(6), rng.random())])
            if number % 4 > 1:
                lane.driver.resume()
            for _ in range(2):
                lane.driver.step()
            lane.driver.check_points()
            assert lane.network.struck
