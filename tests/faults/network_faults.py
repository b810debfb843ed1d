"""A network with faults between clients and a real server, which itself is sometimes killed and started again.

Each seed chooses faults (:mod:`.faulty_network`) that occur while a session continues, is resumed or is opened. Every
call of the client must return its result or a typed error by its deadline. The session then continues or is resumed at
its last acknowledged step; all arrays and digests are, bit for bit, those of an undisturbed session; and no request is
executed twice (:mod:`.network_driver`).

Half of the clients have keys. CURVE detects changed bytes, so these clients get ``flip`` and ``truncate`` among their
faults, and the whole promise holds for them. Without keys the protocol has only TCP's checksum: then the only promise
is that each call ends in time with a result or a typed error, and the row reports how many changed arrays were
accepted.
"""

from __future__ import annotations

import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path
from random import Random, SystemRandom
from typing import Any

from mesh_motion_client import Keys

from tests.faults.check import Budget, Check, Result, require
from tests.faults.faulty_network import CORRUPTING, KINDS, Fault, Network
from tests.faults.network_driver import Driver, Work
from tests.faults.server_process import ServerProcess, make_keys
from tests.faults.stand_in_server import StandInServer

#: Clients at work at the same time, every other one with keys.
_LANES = 4
#: Steps of each seed while faults strike.
_STEPS = 2
_SETTINGS = {"handshake_seconds": 1.0, "lease_seconds": 2.0, "idle_seconds": 5.0}
#: How a seed begins, and how often.
_BEGINNINGS = {"go on": 12, "resume": 6, "open": 2}
#: How often each kind is chosen; a restart takes seconds, and all clients see it.
_WEIGHTS = {"restart": 0.3, "drop": 0.7, "half-open": 0.7}
#: One of so many seeds without keys is for bytes that are changed.
_CORRUPTED = 6


def loopback() -> str:
    """A loopback address that no other program uses: all its ports are free."""
    rng = SystemRandom()
    return f"127.{rng.randrange(16, 255)}.{rng.randrange(256)}.{rng.randrange(1, 255)}"


def places_of(ports: range) -> dict[str, Any]:
    """Settings of a server behind networks: its endpoint, on a separate address, and its data ports."""
    return {
        "endpoint": f"tcp://{loopback()}:{ports[0] - 1}",
        "advertised_host": "0.0.0.0",
        "data_ports": f"{ports[0]}-{ports[-1]}",
        "max_sessions": len(ports) - 2,
    }


class Lane:
    """One client behind its own network.

    ``keys`` (Keys or None); ``crossing``: shared by the lanes of a server; ``work``: its task. ``struck``: faults by
    kind; ``seen``: "quiet" seeds, in which no fault occurred (too few units passed); without keys also the seeds with
    "changed" bytes, and those of them with an "unnoticed" wrong result.
    """

    def __init__(
        self,
        server: ServerProcess,
        keys: Keys | None,
        crossing: set[int],
        restart: Callable[[], None],
        work: Work | None = None,
    ) -> None:
        host, _, port = server.endpoint.removeprefix("tcp://").rpartition(":")
        ports = [int(end) for end in server.settings["data_ports"].split("-")]
        data_ports = range(ports[0], ports[1] + 1)
        self.network = Network(loopback(), (host, int(port)), data_ports, crossing=crossing, restart=restart)
        self.server = server
        self.driver = Driver(self.network.endpoint, keys, work or Work())
        self.struck, self.seen = Counter[str](), Counter[str]()
        self.failure: Exception | None = None

    def open(self) -> None:
        """Make, without faults, the sessions that the seeds use."""
        self.network.heal()
        self.driver.open()

    def run(self, seed: int) -> None:
        """Run one seed; then end all faults, and take one more step."""
        rng = Random(f"network {seed}")
        begin = rng.choices(list(_BEGINNINGS), list(_BEGINNINGS.values()))[0]
        if self.driver.keys is None and seed // _LANES % _CORRUPTED == 0:
            self._run_corrupted(rng)
            return
        self.network.arm(faults_of(rng, begin, corrupting=self.driver.keys is not None))
        if begin == "resume":
            self.driver.resume()
        elif begin == "open":
            self.driver.open()
        for _ in range(_STEPS):
            self.driver.step()
        self.driver.check_points()
        self.struck.update(self.network.struck)
        self.seen["quiet"] += not self.network.struck
        self.network.heal()
        self.driver.step()
        self.driver.check_points()

    def _run_corrupted(self, rng: Random) -> None:
        """Use a session without keys and discard it afterwards, because its inputs are unknown."""
        faults = [_fault(rng, rng.choice(CORRUPTING), "go on") for _ in range(2)]
        self.network.arm(faults)
        mistaken = self.driver.step_of_doubt()
        self.struck.update(f"{kind} (no keys)" for kind in self.network.struck)
        self.seen["changed"] += bool(self.network.struck)
        self.seen["unnoticed"] += mistaken
        self.open()


def faults_of(rng: Random, begin: str, *, corrupting: bool) -> list[Fault]:
    kinds = [*KINDS, *(CORRUPTING if corrupting else ())]
    weights = [_WEIGHTS.get(kind, 1.0) for kind in kinds]
    chosen = rng.choices(kinds, weights, k=rng.choice((1, 1, 2, 3)))
    return [_fault(rng, kind, begin) for kind in chosen]


def _fault(rng: Random, kind: str, begin: str) -> Fault:
    """A random place: on the data connection, or on the control connection if the task makes one."""
    place = "data" if begin == "go on" or rng.random() < 0.6 else "control"
    most = 12 if begin == "open" and place == "data" else 6
    return Fault(kind, place, rng.choice(("in", "out")), rng.randrange(most), rng.random())


@contextmanager
def lanes(folder: Path, numbers: Sequence[int]) -> Iterator[list[Lane]]:
    """Clients, each with an open session, and their servers; odd numbers have keys."""
    with ExitStack() as stack, ThreadPoolExecutor(_LANES) as pool:
        sides = sorted({bool(number % 2) for number in numbers})
        servers = {side: _server(folder / f"keys {side}", with_keys=side) for side in sides}
        for server, _ in servers.values():
            stack.callback(server.stop)
        list(pool.map(lambda pair: pair[0].start(), servers.values()))
        crossings: dict[bool, set[int]] = {side: set() for side in sides}
        restarts = {side: restarter(servers[side][0]) for side in sides}
        made = []
        for number in numbers:
            side = bool(number % 2)
            made.append(Lane(*servers[side], crossings[side], restarts[side]))
            stack.callback(made[-1].network.close)
        list(pool.map(Lane.open, made))
        yield made
        for lane in made:
            lane.network.heal()
            lane.driver.close()


def _server(folder: Path, *, with_keys: bool) -> tuple[StandInServer, Keys | None]:
    """A server on a separate address, and its client's keys."""
    settings = _SETTINGS | places_of(range(20000, 20032))
    if not with_keys:
        return StandInServer(folder, **settings), None
    keys = make_keys(folder)
    return StandInServer(folder, **settings | {"keys_folder": str(folder / "keys")}), keys


def restarter(server: ServerProcess) -> Callable[[], None]:
    lock = threading.Lock()

    def restart() -> None:
        with lock:
            server.kill()
            server.start()

    return restart


def run_seeds(lanes: Sequence[Lane], seed: int, budget: Budget) -> int:
    """Give seeds to the lanes until the budget is spent or a promise is broken; return the number of seeds.

    Raises BrokenPromise that names the seed.
    """
    lock, done, over = threading.Lock(), 0, threading.Event()

    def admitted() -> bool:
        nonlocal done
        with lock:
            more = not over.is_set() and budget.admits(done)
            done += more
            return more

    def work(lane: Lane, number: int) -> None:
        while admitted():
            try:
                lane.run(number)
            except Exception as error:
                error.add_note(f"(seed {number})")
                lane.failure = error
                over.set()
            number += len(lanes)

    threads = [
        threading.Thread(target=work, args=(lane, seed + index), name=f"seeds of {index}", daemon=True)
        for index, lane in enumerate(lanes)
    ]
    for thread in threads:
        thread.start()
    try:
        _watch(lanes, threads)
    finally:
        over.set()
    return done


def _watch(lanes: Sequence[Lane], threads: Sequence[threading.Thread]) -> None:
    """Wait for the lanes; detect a call that does not return."""
    while True:
        alive = any(thread.is_alive() for thread in threads)
        for lane in lanes:
            if lane.failure is not None:
                raise lane.failure
            what, deadline = lane.driver.under_way or ("", float("inf"))
            require(time.monotonic() < deadline, f"{what} has not returned long after its deadline")
        if not alive:
            return
        time.sleep(0.05)


def run(seed: int, budget: Budget) -> Result:
    with tempfile.TemporaryDirectory(prefix="mesh-motion-prove-") as folder, lanes(Path(folder), range(_LANES)) as made:
        done = run_seeds(made, 1_000_000 * seed, budget)
        struck, seen, errors = (
            sum((getattr(each, what) for each in parts), Counter[str]())
            for parts, what in ((made, "struck"), (made, "seen"), ([lane.driver for lane in made], "errors"))
        )
    details = {"seeds": done, "faults": dict(struck), "errors": dict(errors), "seen": dict(seen)}
    unseen = f"{seen['unnoticed']} of {seen['changed']} changes unseen"
    got = f"{done} seeds, {struck.total()} faults; without keys {unseen}"
    return Result(got, passed=True, details=details)


CHECK = Check(
    "network-faults",
    "{count} seeds: result or typed error in time, all bitwise",
    short=50,
    full=1000,
    seconds=40,
    run=run,
)
