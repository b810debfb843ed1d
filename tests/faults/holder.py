"""The black-box client: it keeps a session through all faults and uses only SPEC.md.

A request is repeated with the same id until it is answered; without an answer PROBE shows whether the worker lives;
then the holder joins again, after a RESUME if the worker has ended. Every reply must stay true: an acknowledged step is
never lost, an epoch is never given twice, and an error has a known code and goes away. Without faults (``calm``),
silence and errors are broken promises.
"""

from __future__ import annotations

import time
import uuid
from collections import Counter
from dataclasses import replace
from typing import Any

import numpy as np
from mesh_motion_client import Keys
from mesh_motion_protocol import messages as m
from mesh_motion_protocol.errors import ERROR_CODES
from numpy.typing import NDArray

from mesh_motion_server.session.partitions.meshes import PartitionMesh
from tests.faults.check import BrokenPromise, require
from tests.faults.driver import Driver, parts_of, undisturbed_driver
from tests.faults.stand_in import grid_mesh
from tests.faults.undisturbed import frames_of
from tests.faults.waiting import PATIENCE
from tests.faults.wire import Wire

Floats = NDArray[np.float64]

#: Silence after which it is looked whether a worker is there; it doubles from look to look.
SILENCE, _LONGEST_SILENCE = 0.3, 5.0
#: Between two looks at a worker that starts.
_PAUSE = 0.05
#: Refusals of one task: a single fault causes some in a row, but they pass.
_MOST_REFUSALS = 20
#: Nothing that breaks in the server may make one of these the answer to a request that is right.
_NEVER = {"ABORTED.CONFLICT", "ABORTED.STALE", "FAILED_PRECONDITION.STEP", "DATA_LOSS.CHECKSUM", "PERMISSION_DENIED"}
_LOST = {"ABORTED.TRIAL_LOST", "FAILED_PRECONDITION.STATE"}
_SPOILT = {"FROZEN", "FAILED"}
#: A server that is full may become less so when a worker has ended.
_FULL = "RESOURCE_EXHAUSTED.SESSIONS"


class SessionLost(Exception):
    """There is no such session: correct for one that was never built, or discarded."""


class TrialLost(Exception):
    """A COMMIT came after its trial was lost."""


class Holder:
    """Holds one session, over all its connections and epochs.

    ``server``: has an ``endpoint`` and, unless ``calm``, the methods of a :class:`.failing_server.FailingServer`;
    ``meshes``: by partition; ``client``: id of its requests to the data endpoint; ``keys``: of its user. ``step``: last
    acknowledged step; ``committing``: whether the next step's COMMIT waits for its reply; ``built``: whether the mesh
    is known to be durable; ``refusals``: number of error replies by code.
    """

    def __init__(
        self,
        server: Any,
        meshes: list[PartitionMesh],
        *,
        client: bytes | None = None,
        keys: Keys | None = None,
        calm: bool = False,
    ) -> None:
        self.server, self.meshes, self.keys, self.calm = server, meshes, keys, calm
        self.session, self.token, self.endpoint, self.epoch, self.step = "", b"", "", 0, 0
        self.committing = self.built = self.leaving = False
        self.refusals: Counter[str] = Counter()
        self._client, self._control, self._sequence = client or uuid.uuid4().bytes, uuid.uuid4().bytes, 0
        self._lines: list[Wire] = []
        self.begin()

    def begin(self) -> None:
        """Begin a new task with a new limit of time and of refusals."""
        self._deadline, self._refused = time.monotonic() + PATIENCE, 0
        self._patience = PATIENCE if self.calm else SILENCE

    def open(self, **fields: Any) -> None:
        """Bring the session from OPEN to READY; begin again if it is lost before it is durable."""
        self.begin()
        everybody = range(len(self.meshes))
        while not self.built:
            try:
                opened = self.ask(m.Open, dimension=2, partitions=len(self.meshes), **fields)
                self.session, self.token = opened.session, opened.token
                self.endpoint, self.epoch = opened.endpoint, opened.epoch
                self.join()
                for p in everybody:
                    for item, name, role, rows in parts_of(self.meshes[p]):
                        self.deliver([self.new(m.Upload, p, item=item, name=name, role=role, rows=rows)])
                self.deliver([self.new(m.Build, p) for p in everybody])
            except SessionLost:
                continue
            self.built = True

    def leave(self, outcome: str = "keep") -> None:
        self.leaving = outcome == "discard"
        try:
            self.deliver([self.new(m.Close, p, outcome=outcome) for p in range(len(self.meshes))])
        except SessionLost:
            require(self.leaving, f"the session {self.session} is lost")
        self.disconnect()

    def disconnect(self) -> None:
        """Cut the connections to the worker without a message; idempotent."""
        while self._lines:
            self._lines.pop().close()

    # --- one request -------------------------------------------------------------------------------------------------

    def new(self, kind: Any, partition: int, **fields: Any) -> Any:
        self._sequence += 1
        known = {"client": self._client, "sequence": self._sequence, "session": self.session, "partition": partition}
        return kind(**known | {"epoch": self.epoch} | fields)

    def deliver(self, requests: list[Any]) -> list[Any]:
        """Send requests of different partitions, each until its reply is no error; return the replies."""
        replies: dict[int, Any] = {}
        while len(replies) < len(requests):
            if not self._lines:
                replies.clear()
                self.connect()
                if isinstance(requests[0], m.Build) and self.built:
                    return []  # it was made before its reply was lost
            waiting = [request for request in requests if request.partition not in replies]
            for request in waiting:
                self._lines[request.partition].send(replace(request, epoch=self.epoch))
            answers = {r.partition: self._lines[r.partition].receive(r, self._patience) for r in waiting}
            good = {p: answer for p, answer in answers.items() if answer is not None and answer.type != "ERROR"}
            replies |= good
            if len(good) < len(answers):
                self._bad(requests[0], [answer for answer in answers.values() if answer and answer.type == "ERROR"])
        self._patience = PATIENCE if self.calm else SILENCE
        return [replies[request.partition] for request in requests]

    def ask(self, kind: Any, **fields: Any) -> Any:
        """Send a control request until its reply is no error; the caller handles NOT_FOUND."""
        self._sequence += 1
        request = kind(client=self._control, sequence=self._sequence, **fields)
        while True:
            self._require_time(request.type)
            if not self.calm:
                self.server.ensure()
            with Wire(self.server.endpoint, self.keys) as wire:
                wire.send(request)
                reply = wire.receive(request, self._patience)
            if reply is None:
                self._patience = min(2 * self._patience, _LONGEST_SILENCE)
                continue
            if reply.type != "ERROR":
                return reply
            if reply.code == "NOT_FOUND":
                require(not self.built or self.leaving, f"{request.type}: there is no session {self.session} any more")
                raise SessionLost
            if reply.code != _FULL:
                self._refusal(request, reply)
            time.sleep(_PAUSE)
            self._sequence += 1
            request = replace(request, sequence=self._sequence)

    def _bad(self, request: Any, errors: list[m.ErrorReply]) -> None:
        """After errors or silence join again; the result shows what to do next."""
        self.disconnect()
        for error in errors:
            self._refusal(request, error)
            if isinstance(request, m.Commit) and error.code in _LOST and error.state == "READY":
                raise TrialLost
        if not errors:
            self._require_time(request.type)
            require(not self.calm, f"{request.type} of session {self.session} is not answered")
            self._patience = min(2 * self._patience, _LONGEST_SILENCE)

    def _refusal(self, request: m.Message, error: m.ErrorReply) -> None:
        """Count an error; it must be allowed."""
        self.refusals[error.code] += 1
        self._refused += 1
        message = f"{request.type} is answered {error.code}: {error.message}"
        require(error.code in ERROR_CODES and error.code not in _NEVER and not self.calm, message)
        require(self._refused <= _MOST_REFUSALS, f"{message}; again and again")
        self._require_time(request.type)

    def _require_time(self, what: str) -> None:
        if time.monotonic() > self._deadline:
            words = "" if self.calm else self.server.last_words()
            raise BrokenPromise(f"{what}: nothing within {PATIENCE:.0f} s; {words}")

    # --- connections -------------------------------------------------------------------------------------------------

    def connect(self) -> None:
        """Join on new connections, after a RESUME if no worker serves the session."""
        while not self._lines:
            self._require_time("JOIN")
            probed = self.ask(m.Probe, session=self.session, token=self.token)
            if probed.worker == "starting":
                time.sleep(_PAUSE)
                continue
            if probed.worker != "alive" or probed.epoch != self.epoch:
                self.resume()
            else:
                self.endpoint = probed.endpoint
            self.join()

    def join(self) -> None:
        """Make new connections to the endpoint and join them; none if that fails."""
        self.disconnect()
        self._lines = [Wire(self.endpoint, self.keys) for _ in self.meshes]
        joins = [self.new(m.Join, p, token=self.token) for p in range(len(self.meshes))]
        for line, join in zip(self._lines, joins, strict=True):
            line.send(join)
        replies = [line.receive(join, self._patience) for line, join in zip(self._lines, joins, strict=True)]
        states = {reply.state for reply in replies if reply is not None}
        for join, reply in zip(joins, replies, strict=True):
            if reply is None or reply.type == "ERROR":
                self._bad(join, [reply] if reply else [])
        if not self._lines:
            if states & {"COMMITTING"}:
                self.resume()
            return
        self._take(replies[0].step)
        self.built = self.built or not states & {"NEW", "OPENING"}
        if states & _SPOILT:
            self._reopen()

    def _reopen(self) -> None:
        """CLOSE a session that cannot continue, and RESUME it, as the hint of its error says."""
        for p, line in enumerate(self._lines):
            request = self.new(m.Close, p)
            line.send(request)
            line.receive(request, self._patience)
        self.disconnect()
        self.resume()

    def resume(self) -> None:
        """Send RESUME only; the caller makes the connections."""
        resumed = self.ask(m.Resume, session=self.session, token=self.token)
        require(resumed.epoch > self.epoch, f"RESUME gives epoch {resumed.epoch} after epoch {self.epoch}")
        self.endpoint, self.epoch = resumed.endpoint, resumed.epoch
        self._take(resumed.step)

    def _take(self, step: int) -> None:
        """Check a step of the server: it must be the acknowledged one, or the one that waits for its reply."""
        possible = (self.step, self.step + 1) if self.committing else (self.step,)
        require(step in possible, f"the session is at step {step}, step {self.step} was acknowledged")


# --- a session that a seed gives, where nothing breaks ---------------------------------------------------------------

#: Each of them is the same client, so that request ids of different sessions are the same.
_CLIENT = b"the same client."


def seeded_mesh(seed: int) -> PartitionMesh:
    """A square; the seed chooses its size and inner nodes."""
    mesh = grid_mesh(4 + seed % 5)
    points = mesh.points.copy()
    inner = np.all((points > 0) & (points < 1), axis=1)
    points[inner] += np.random.default_rng(seed).uniform(-0.1, 0.1, (inner.sum(), 2)) / (3 + seed % 5)
    return replace(mesh, points=points)


def seeded_rows(seed: int, step: int, iteration: int, count: int) -> Floats:
    """(count, 2) displacement of the moving nodes: small; the next step undoes it except for its own part."""
    rows = np.random.default_rng([seed, (step + 1) // 2, iteration]).uniform(-1e-3, 1e-3, (count, 2))
    return rows if step % 2 else -rows


def twin_of(seed: int, steps: int) -> Driver:
    """A session with the seed's mesh on the model file system, after this number of steps of one iteration each."""
    driver = undisturbed_driver([seeded_mesh(seed)])
    for step in range(1, steps + 1):
        driver.all(m.Move, [seeded_rows(seed, step, 1, len(driver.moving[0]))], step=step)
        driver.all(m.Commit, step=step)
    return driver


class SeededHolder(Holder):
    """One session of one partition.

    ``seed``: seed of its mesh and its motions.
    """

    def __init__(self, server: Any, seed: int) -> None:
        super().__init__(server, [seeded_mesh(seed)], client=_CLIENT, calm=True)
        self.seed, self.iteration = seed, 0

    @property
    def moving(self) -> int:
        return len(self.meshes[0].patches["left"].nodes)

    def known_as(self, session: str, token: bytes, step: int) -> SeededHolder:
        self.session, self.token, self.step, self.built = session, token, step, True
        return self

    def come_back(self) -> None:
        """Resume the session; while the server is full, try again for some time."""
        self.begin()
        self.resume()
        self.iteration = 0
        self.join()

    def move(self, *, repeats: int = 0) -> m.Moved:
        """Send the next iteration of the seed's motion, and this number of repeats with the same request id."""
        self.iteration += 1
        rows = seeded_rows(self.seed, self.step + 1, self.iteration, self.moving)
        moved: m.Moved = self.request(m.Move, repeats, frame="committed", step=self.step + 1, displacement=rows)
        return moved

    def commit(self, *, repeats: int = 0) -> m.Committed:
        committed: m.Committed = self.request(m.Commit, repeats, step=self.step + 1)
        self.step, self.iteration = committed.step, 0
        return committed

    def rollback(self) -> None:
        self.request(m.Rollback, step=self.step + 1)
        self.iteration = 0

    def request(self, kind: Any, repeats: int = 0, **fields: Any) -> Any:
        """Send a request to the worker; each repeat must get the same reply frames."""
        self.begin()
        request = self.new(kind, 0, **fields)
        (reply,) = self.deliver([request])
        for _ in range(repeats):
            (again,) = self.deliver([request])
            same = frames_of(again) == frames_of(reply)
            require(same, f"session {self.seed}: a repeated {kind.type} is answered by other bytes")
        return reply
