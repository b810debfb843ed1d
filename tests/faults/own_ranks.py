"""A rank that moves, judges and corrects its own nodes, on a network that breaks, with a server that is killed.

The client has the mesh, the server its boundary (section 23 of the protocol). Faults strike between any two of MOVE,
JUDGE, CORRECT, the second JUDGE and COMMIT: of the network (:mod:`.faulty_network`), SIGKILL of the server among them,
and now and then the client itself is gone and another one resumes with mesh and credentials. All displacements and
coordinates must be bitwise those of a session whose server has the whole mesh, and no acknowledged step may be lost.
"""

import contextlib
import signal
import tempfile
import time
from collections import Counter
from contextlib import ExitStack
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
from mesh_motion_client import Mesh, MeshMotionError, Patch, Session, connect
from mesh_motion_client.connection import DamagedReply
from mesh_motion_client.server import Server

from tests.faults.check import Budget, Check, Result, require
from tests.faults.faulty_network import KINDS, Fault, Network
from tests.faults.network_driver import EXCUSED
from tests.faults.network_faults import loopback
from tests.faults.server_process import ServerProcess

_PORTS = range(20100, 20108)
#: Cells along a side; motions, which come in turn: each depends on the reference mesh alone.
_CELLS, _MOTIONS = 12, 4
_SETTINGS = {
    "displacement": "absolute",
    "correction": "optimised",
    "correction_target": "threshold",
    "quality_threshold": 0.7,
    "sub_steps": "never",
}
#: Seconds for a call, and until a call that is repeated has its result.
_CALL, _PATIENCE = 20.0, 120.0
_STEPS = 2
_WEIGHTS = {"restart": 4.0}
_ABANDONED = 0.3  # share of the seeds in which the client is gone in the middle of a step


def square() -> Mesh:
    """Quads in a unit square; the left side moves, all others are fixed."""
    n = _CELLS + 1
    x, y = np.meshgrid(np.linspace(0.0, 1.0, n), np.linspace(0.0, 1.0, n))
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    points = np.stack([x.ravel(), y.ravel()], axis=1)
    left = points[:, 0] == 0.0
    rest = ~left & ((points == 0.0) | (points == 1.0)).any(axis=1)
    cells = {"quad": np.stack([corner, corner + 1, corner + n + 1, corner + n], axis=1)}
    patches = {"left": Patch("moving", np.flatnonzero(left)), "rest": Patch("fixed", np.flatnonzero(rest))}
    return Mesh(points, cells, patches)


def _motion(session: Session, mesh: Mesh, step: int) -> Any:
    """The side's total displacement after a step: a wave so high that cells are bad."""
    y = mesh.points[session.moving_nodes, 1]
    wave = np.sin(np.pi * y) * np.sin(2.0 * np.pi * y + step % _MOTIONS)
    return np.stack([0.25 * wave, np.zeros_like(y)], axis=1)


def undisturbed() -> list[Any]:
    """Displacements (n, d) of all nodes by each motion, of a server with the whole mesh."""
    mesh = square()
    with connect() as server, server.open(mesh, _SETTINGS) as session:
        moves = [session.move(_motion(session, mesh, step)) for step in range(_MOTIONS)]
    require(all(moved.correction["freed_nodes"] for moved in moves), "a motion has no cells to correct")
    return [np.array(moved.displacement) for moved in moves]


class Rank:
    """One client behind a network.

    ``server``: is running; ``expected`` (list of (n, d) arrays): of :func:`undisturbed`. ``errors``: codes of the
    errors that calls have raised.
    """

    def __init__(self, server: ServerProcess, expected: list[Any]) -> None:
        host, _, port = server.endpoint.removeprefix("tcp://").rpartition(":")
        self._process = server
        self.network = Network(loopback(), (host, int(port)), _PORTS, crossing=set(), restart=self.restart)
        self.errors: Counter[str] = Counter()
        self._expected, self._mesh = expected, square()
        self._server: Server | None = None
        self._session: Session = self._connected().open(self._mesh, _SETTINGS, evaluation="client")
        self._credentials = self._session.credentials
        self.acknowledged = 0

    def restart(self) -> None:
        """Kill the server and start it again."""
        self._process.stop(signal.SIGKILL)
        self._process.start()

    def run(self, seed: int) -> None:
        """A seed: steps among faults, then one in peace."""
        random = Random(f"own ranks {seed}")
        kinds = [kind for kind in KINDS if kind != "half-open"]  # that one is silence, and takes a call's whole time
        chosen = random.choices(kinds, [_WEIGHTS.get(kind, 1.0) for kind in kinds], k=random.choice((1, 1, 2)))
        self.network.arm(
            [
                Fault(kind, "data", random.choice(("in", "out")), random.randrange(10), random.random())
                for kind in chosen
            ]
        )
        for _ in range(_STEPS):
            self._step(abandon=random.random() < _ABANDONED)
        self.network.heal()
        self._step()

    def close(self) -> None:
        """End everything."""
        self.network.heal()
        self._again("CLOSE", lambda: self._session.close("discard"))
        self._disconnect()
        self.network.close()

    def _step(self, *, abandon: bool = False) -> None:
        """The next one, whatever it takes; then the coordinates."""
        step = self.acknowledged + 1
        wanted = self._expected[step % _MOTIONS]

        def move_and_commit() -> None:
            if self._session.step < step:
                moved = self._session.move(_motion(self._session, self._mesh, step), timeout=_CALL)
                require(np.array_equal(moved.displacement, wanted), f"the displacement of step {step} is another one")
                self._session.commit(timeout=_CALL)

        if abandon:
            half = 0.5 * _motion(self._session, self._mesh, step)
            self._again("MOVE", lambda: self._session.move(half, timeout=_CALL))
            self._resume()
        self._again("MOVE and COMMIT", move_and_commit)
        require(self._session.step == step, f"the session is at step {self._session.step}, not at {step}")
        self.acknowledged = step
        points = self._again("FETCH", lambda: self._session.points(timeout=_CALL))
        require(np.array_equal(points, self._mesh.points + wanted), f"the coordinates of step {step} are others")

    def _again(self, what: str, action: Any) -> Any:
        """A call, until it has its result; an error that repeating does not cure is followed by a resume."""
        deadline = time.monotonic() + _PATIENCE
        while True:
            try:
                return action()
            except MeshMotionError as error:
                self.errors[error.code] += 1
                excused = error.code.startswith(EXCUSED) or isinstance(error, DamagedReply)
                require(excused, f"{what} raised {error.code}: {error}")
                require(time.monotonic() < deadline, f"{what} has no result within {_PATIENCE} s: {error}")
                self._resume()

    def _resume(self) -> None:
        """As another process would that has mesh and credentials."""
        deadline, old = time.monotonic() + _PATIENCE, self._session
        while True:
            self._disconnect()
            try:
                self._session = self._connected().resume(self._credentials, self._mesh)
            except MeshMotionError as error:
                self.errors[error.code] += 1
                require(error.code.startswith(EXCUSED), f"RESUME raised {error.code}: {error}")
                require(time.monotonic() < deadline, f"RESUME has no result within {_PATIENCE} s: {error}")
            else:
                admitted = (self.acknowledged, self.acknowledged + 1)
                step = self._session.step
                require(step in admitted, f"resumed at step {step}, {self.acknowledged} was acknowledged")
                with contextlib.suppress(MeshMotionError):
                    old.close()  # it is fenced
                return

    def _connected(self) -> Server:
        self._server = connect(self.network.endpoint, timeout=_CALL, compute_timeout=_CALL)
        return self._server

    def _disconnect(self) -> None:
        if self._server is not None:
            self._server.close()
            self._server = None


def run(seed: int, budget: Budget) -> Result:
    """So many seeds."""
    expected, done = undisturbed(), 0
    struck: Counter[str] = Counter()
    with tempfile.TemporaryDirectory(prefix="mesh-motion-prove-") as folder, ExitStack() as stack:
        settings: dict[str, Any] = {
            "endpoint": f"tcp://{loopback()}:{_PORTS[0] - 1}",
            "advertised_host": "0.0.0.0",
            "data_ports": f"{_PORTS[0]}-{_PORTS[-1]}",
            "max_sessions": len(_PORTS) - 2,
        }
        server = stack.enter_context(ServerProcess(Path(folder), **settings))
        rank = Rank(server, expected)
        stack.callback(rank.close)
        while budget.admits(done):
            rank.run(1_000_000 * seed + done)
            struck.update(rank.network.struck)
            done += 1
        steps = rank.acknowledged
    details = {"seeds": done, "steps": steps, "faults": dict(struck), "errors": dict(rank.errors)}
    got = f"{done} seeds, {struck.total()} faults, {struck['restart']} of them kills; {steps} corrected steps alike"
    return Result(got, passed=True, details=details)


CHECK = Check(
    "own-ranks",
    "{count} seeds: corrected by the ranks, bitwise as the whole mesh",
    short=8,
    full=300,
    seconds=30,
    run=run,
)
