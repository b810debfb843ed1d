"""A session held by hand over the wire, and its undisturbed twin in this process, which says what must be answered."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np
from mesh_motion_client import Keys
from mesh_motion_protocol import messages as m
from numpy.typing import NDArray

from mesh_motion_server.session.partitions.meshes import PartitionMesh
from tests.faults.check import BrokenPromise, require
from tests.faults.driver import Driver, parts_of, undisturbed_driver
from tests.faults.stand_in import grid_mesh
from tests.faults.wire import Wire

Floats = NDArray[np.float64]

#: Every holder is the same client and counts from 1, so that request ids of different sessions are the same.
_CLIENT = b"the same client."
#: A server that is full may become less so when a worker has ended; seconds.
_PATIENCE = 60.0
_PAUSE = 0.05


def seeded_mesh(seed: int) -> PartitionMesh:
    """A square whose size and inner nodes are the seed's own."""
    mesh = grid_mesh(4 + seed % 5)
    spacing = 1 / (3 + seed % 5)
    points = mesh.points.copy()
    inner = np.all((points > 0) & (points < 1), axis=1)
    points[inner] += np.random.default_rng(seed).uniform(-0.1, 0.1, (inner.sum(), 2)) * spacing
    return replace(mesh, points=points)


def seeded_rows(seed: int, step: int, iteration: int, count: int) -> Floats:
    """(count, 2) displacement of the moving nodes: small, and undone by the next step but for its own part."""
    rows = np.random.default_rng([seed, (step + 1) // 2, iteration]).uniform(-1e-3, 1e-3, (count, 2))
    return rows if step % 2 else -rows


def twin_of(seed: int, steps: int) -> Driver:
    """A session of the seed's mesh, on the model file system, after so many steps of one iteration each."""
    driver = undisturbed_driver([seeded_mesh(seed)])
    for step in range(1, steps + 1):
        driver.all(m.Move, [seeded_rows(seed, step, 1, len(driver.moving[0]))], step=step)
        driver.all(m.Commit, step=step)
    return driver


class Holder:
    """One session over the wire.

    ``endpoint``: of the server's control socket; ``seed``: of its mesh and its motions. ``endpoint``: of the data
    socket, while there is a worker.
    """

    def __init__(self, control: str, seed: int, keys: Keys | None = None) -> None:
        self.seed, self.mesh = seed, seeded_mesh(seed)
        self.session, self.token, self.endpoint = "", b"", ""
        self.epoch = self.step = self.iteration = 0
        self.sequence = 0
        self.control, self._keys = control, keys
        self._data: Wire | None = None

    @property
    def moving(self) -> int:
        """Number of moving nodes."""
        return len(self.mesh.patches["left"].nodes)

    def open(self, label: str = "", **settings: Any) -> None:
        """From OPEN to BUILT.

        Raises BrokenPromise if anything is not answered as it should; ``code`` in its message.
        """
        settings = {"support_radius": 2.0} | settings
        opened = self._ask_control(m.Open, "OPENED", dimension=2, settings=settings, label=label)
        self.session, self.token = opened.session, opened.token
        self.endpoint, self.epoch, self.step = opened.endpoint, opened.epoch, 0
        self.join()
        for item, name, role, rows in parts_of(self.mesh):
            if item != "global_ids":  # a mesh as a whole needs none
                self.ask(m.Upload, "UPLOADED", item=item, name=name, role=role, rows=rows)
        self.ask(m.Build, "BUILT")

    def known_as(self, session: str, token: bytes, step: int) -> Holder:
        """This holder, of a stored session."""
        self.session, self.token, self.step = session, token, step
        return self

    def resume(self) -> None:
        """Take the session up again; a server that is full is asked again for a while.

        Raises BrokenPromise if it is not at its step.
        """
        resumed = self._ask_control(m.Resume, "RESUMED", session=self.session, token=self.token)
        require(
            resumed.step == self.step, f"session {self.seed} resumes at step {resumed.step}, {self.step} is committed"
        )
        self.endpoint, self.epoch, self.iteration = resumed.endpoint, resumed.epoch, 0
        self.join()

    def join(self) -> None:
        """A connection of its own, in place of one before."""
        endpoint = self.endpoint
        self.disconnect()
        self.endpoint, self._data = endpoint, Wire(endpoint, self._keys)
        self.ask(m.Join, "JOINED", token=self.token)

    def move(self, *, repeats: int = 0) -> m.Moved:
        """The next iteration of the seed's motion; sent again so many times, under the same request id."""
        self.iteration += 1
        rows = seeded_rows(self.seed, self.step + 1, self.iteration, self.moving)
        moved: m.Moved = self.ask(
            m.Move, "MOVED", repeats=repeats, frame="committed", step=self.step + 1, displacement=rows
        )
        return moved

    def commit(self, *, repeats: int = 0) -> m.Committed:
        """Commit the trial."""
        committed: m.Committed = self.ask(m.Commit, "COMMITTED", repeats=repeats, step=self.step + 1)
        self.step, self.iteration = committed.step, 0
        return committed

    def rollback(self) -> None:
        """Drop the trial."""
        self.ask(m.Rollback, "ROLLED_BACK", step=self.step + 1)
        self.iteration = 0

    def points(self) -> Floats:
        """(n, 2) committed coordinates."""
        return np.asarray(self.ask(m.Fetch, "FETCHED").points)

    def status(self) -> m.StatusReport:
        """Where it stands."""
        report: m.StatusReport = self.ask(m.Status, "STATUS_REPORT")
        return report

    def close(self, outcome: str = "keep") -> None:
        """CLOSE, and cut the connection."""
        self.ask(m.Close, "CLOSED", outcome=outcome)
        self.disconnect()

    def disconnect(self) -> None:
        """Cut the connection without a word; idempotent."""
        self.endpoint = ""
        if self._data is not None:
            self._data.close()
            self._data = None

    def ask(self, kind: Any, expected: str, *, repeats: int = 0, **fields: Any) -> Any:
        """A request to the worker; each repeat must be answered by the same frames."""
        require(self._data is not None, f"session {self.seed} is not joined")
        self.sequence += 1
        fields |= {"client": _CLIENT, "sequence": self.sequence, "session": self.session, "epoch": self.epoch}
        reply, frames = self._once(kind, fields)
        require(reply.type == expected, f"session {self.seed}: {kind.type} was answered {reply}")
        for _ in range(repeats):
            _, again = self._once(kind, fields)
            require(again == frames, f"session {self.seed}: a repeated {kind.type} is answered by other bytes")
        return reply

    def _once(self, kind: Any, fields: dict[str, Any]) -> tuple[Any, list[bytes]]:
        if self._data is None:
            raise BrokenPromise(f"session {self.seed} is not joined")
        reply = self._data.ask(kind, **fields)
        return reply, self._data.frames

    def _ask_control(self, kind: Any, expected: str, **fields: Any) -> Any:
        """A request to the control socket, again while the server is full."""
        deadline = time.monotonic() + _PATIENCE
        with Wire(self.control, self._keys) as wire:
            while (reply := wire.ask(kind, **fields)).type != expected:
                full = getattr(reply, "code", "") == "RESOURCE_EXHAUSTED.SESSIONS"
                require(full, f"session {self.seed}: {kind.type} was answered {reply}")
                require(time.monotonic() < deadline, f"no worker ended within {_PATIENCE:.0f} s: {reply.message}")
                time.sleep(_PAUSE)
        return reply
