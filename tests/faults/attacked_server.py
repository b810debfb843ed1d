"""A whole server under attack, with and without keys: no process ends, and nothing of the attackers is kept.

Many broken connections go to the control and the data endpoints of two servers, each with a session. Then come silent
connections, a CURVE HELLO of 300 MB, a message without end and, if there are keys against it, a peer that names itself
a user. Afterwards the processes must be the same, with as many open files as at the start and hardly more memory, and
both sessions must take their next step.
"""

import tempfile
import time
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from mesh_motion_client import Keys, connect
from mesh_motion_client.control import Control
from mesh_motion_client.session import Session
from mesh_motion_protocol.codec import encode
from mesh_motion_protocol.messages import List, Probe, Probed

from tests.faults.attacks import ended, endless_message, forged_user, half_open, oversized_hello, storm
from tests.faults.check import Budget, Check, Result, require
from tests.faults.client_mesh import client_mesh
from tests.faults.processes import Usage, descendants, usage_of
from tests.faults.server_process import ServerProcess, make_keys
from tests.faults.stand_in import grid_mesh
from tests.faults.waiting import wait_until

_MIB = 1 << 20
#: Connections of one storm; between storms it is looked whether all processes live.
_STORM = 100
#: Silent connections to each endpoint.
_SILENT = 100
#: Seconds until a server has given everything back.
_PATIENCE = 30.0
#: Bytes that fit into the kernel's buffers before a server ends a connection.
_MOST_TAKEN = 16 * _MIB
#: Bytes by which the memory of a process may grow.
_MOST_GROWTH = 16 * _MIB


class Target:
    """A server with a session, observed from outside.

    ``name``: "with keys" or "without keys"; ``keys`` (Keys or None); ``endpoints``: "control" and "data".
    """

    def __init__(self, name: str, process: int, endpoint: str, keys: Keys | None) -> None:
        self.name, self.keys, self._process = name, keys, process
        self._server = connect(endpoint, keys=keys)
        self._session = self._open()
        self._control = Control(endpoint, keys)
        credentials = self._session.credentials
        probed = self._control.ask(Probe, Probed, _PATIENCE, session=credentials.session, token=credentials.token)
        self.endpoints = {"control": endpoint, "data": probed.endpoint}
        self.step()
        self._settle()
        self._calm = self.usage()

    def _open(self) -> Session:
        return self._server.open(client_mesh(grid_mesh()), {"support_radius": 2.0})

    def _settle(self) -> None:
        """Wait until the worker has loaded its modules in the background: its memory is the same for two seconds."""
        memory: deque[int] = deque(maxlen=10)
        deadline = time.monotonic() + _PATIENCE
        while len(memory) < 10 or max(memory) - min(memory) > _MIB // 4:
            require(time.monotonic() < deadline, f"the memory of the server {self.name} does not come to rest")
            time.sleep(0.2)
            memory.append(sum(usage.resident_bytes for usage in self.usage().values()))

    def usage(self) -> dict[int, Usage]:
        """Open files and memory of each of its processes."""
        return {pid: usage_of(pid) for pid in descendants(self._process)}

    def step(self) -> None:
        rows = np.full((len(self._session.moving_nodes), 2), 1e-3 * (-1) ** self._session.step)
        self._session.move(rows, frame="committed")
        self._session.commit()

    def require_alive(self) -> None:
        """Raise unless the processes are those of the start."""
        now = descendants(self._process)
        gone = self._calm.keys() - now
        require(not gone, f"{len(gone)} processes of the server {self.name} have ended")

    def require_calm(self) -> int:
        """Raise unless files are closed; return the growth in bytes of the process that grew most."""
        wait_until(
            lambda: all(usage_of(pid).files <= calm.files for pid, calm in self._calm.items()),
            f"the server {self.name} gives its descriptors back",
            _PATIENCE,
        )
        return max(usage_of(pid).resident_bytes - calm.resident_bytes for pid, calm in self._calm.items())

    def remember(self) -> None:
        """Take the memory now as that of a calm server: objects that are made only once exist now."""
        now = self.usage()
        self._calm = {pid: Usage(calm.files, now[pid].resident_bytes) for pid, calm in self._calm.items()}

    def close(self) -> None:
        self._session.close("discard")
        self._control.close()
        self._server.close()


@contextmanager
def target(name: str) -> Iterator[Target]:
    with tempfile.TemporaryDirectory(prefix="mesh-motion-prove-") as folder, ExitStack() as stack:
        keys = make_keys(Path(folder)) if name == "with keys" else None
        settings: dict[str, Any] = {"keys_folder": str(Path(folder) / "keys")} if keys else {}
        server = stack.enter_context(ServerProcess(Path(folder), handshake_seconds=0.5, **settings))
        made = Target(name, server.process.pid, server.endpoint, keys)
        stack.callback(made.close)
        yield made


def attack(targets: Sequence[Target], seed: int, budget: Budget) -> tuple[Counter[str], int]:
    """Everything, to all of them.

    Returns the number of broken connections by kind. Returns the growth in bytes of the process that grew most. Raises
    BrokenPromise if a process ends, or keeps or accepts what it must not.
    """
    places = [(target, endpoint) for target in targets for endpoint in target.endpoints.values()]
    for number, (target, endpoint) in enumerate(places):
        storm(endpoint, seed=1_000_000 * (seed + 1) - number, count=_STORM)
        target.require_calm()
        target.remember()
    made: Counter[str] = Counter()
    while budget.admits(made.total()):
        target, endpoint = places[made.total() // _STORM % len(places)]
        made += storm(endpoint, seed=1_000_000 * seed + made.total(), count=_STORM)
        target.require_alive()
        require(not made["not connected"], f"the server {target.name} takes no connections")
    for target, endpoint in places:
        _single_attacks(target, endpoint, seed)
    growths = [target.require_calm() for target in targets]
    for target in targets:
        target.require_alive()
        target.step()
        connect(target.endpoints["control"], keys=target.keys).close()
    return made, max(growths)


def _single_attacks(target: Target, endpoint: str, seed: int) -> None:
    with half_open(endpoint, seed=seed, count=_SILENT) as held:
        require(all(ended(raw) for raw in held), f"the server {target.name} keeps silent connections")
    taken = oversized_hello(endpoint, 300 * _MIB)
    require(taken < _MOST_TAKEN, f"the server {target.name} takes {taken} bytes of a HELLO")
    if target.keys is not None:
        taken = endless_message(endpoint, 64 << 10, 100 * _MIB)
        require(taken < _MOST_TAKEN, f"{taken} bytes of a message without end are taken from a stranger")
        back = forged_user(endpoint, b"root", bytes(encode(List(client=b"c" * 16, sequence=1))[0]))
        require(b"LISTED" not in back, "a peer has named himself a user, and was believed")


def run(seed: int, budget: Budget) -> Result:
    """Make this number of broken connections to two servers, and the single attacks."""
    with target("without keys") as bare, target("with keys") as protected:
        made, growth = attack([bare, protected], seed, budget)
    details = {"connections": made.total(), "kinds": dict(made), "growth_bytes": growth, "exits": 0}
    got = f"{made.total()} connections, 0 exits, files back, {growth / _MIB:+.1f} MB"
    return Result(got, growth < _MOST_GROWTH, details)


CHECK = Check(
    "attacks",
    "{count} broken connections: no exit, files back, < +16 MB",
    short=2000,
    full=100_000,
    seconds=45,
    run=run,
)
