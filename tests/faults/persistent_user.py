"""A coupled solver of two partitions that survives all faults, which must not change any of its numbers.

Every MOVE and COMMIT is sent twice; each reply must be that of an undisturbed run, and COMMITTED equal to the bit.
"""

from contextlib import ExitStack
from dataclasses import replace
from typing import Any

import numpy as np
from mesh_motion_protocol.messages import Commit, Fetch, Hello, List, Move, Ping, Rollback, SessionMessage, Status

from tests.faults.check import require
from tests.faults.failing_server import FailingServer
from tests.faults.holder import SILENCE, Holder, TrialLost
from tests.faults.undisturbed import Undisturbed, committer, frames_of

PARTITIONS = 2


class PersistentUser(Holder):
    """One session's user.

    ``undisturbed``: the run that this one must equal.
    """

    def __init__(self, server: FailingServer, undisturbed: Undisturbed) -> None:
        super().__init__(server, undisturbed.meshes)
        self._undisturbed = undisturbed

    def advance(self) -> None:
        """Send MOVE and COMMIT of the next step, each twice."""
        number = self.step + 1
        expected = self._undisturbed.step(number)
        commits = [self.new(Commit, p, client=committer(p), sequence=number, step=number) for p in range(PARTITIONS)]
        while True:
            self._move(expected.given[0], expected.displacements[0])
            try:
                self.committing = True
                self._require_same(commits, expected.replies)
                break
            except TrialLost:
                continue
        self.step, self.committing = number, False
        self._require_same(commits, expected.replies)

    def change_its_mind(self) -> None:
        """Send a MOVE and roll it back, then the correct one."""
        self._move([-0.5 * rows for rows in self._undisturbed.step(self.step + 1).given[0]], None)
        self.deliver([self.new(Rollback, p, step=self.step + 1) for p in range(PARTITIONS)])
        self.advance()

    def look(self) -> None:
        """Send all requests that change nothing; the session must be in the state of the undisturbed run."""
        self.ask(Hello)
        self.ask(Ping)
        listed = [entry["session"] for entry in self.ask(List).sessions]
        require(self.session in listed, f"the session {self.session} is not in the list of {len(listed)}")
        for status in self.deliver([self.new(Status, p) for p in range(PARTITIONS)]):
            require(status.step == self.step, f"STATUS gives step {status.step}, {self.step} was acknowledged")
        fetched = self.deliver([self.new(Fetch, p) for p in range(PARTITIONS)])
        points = self._undisturbed.points(self.step)
        same = all(np.array_equal(one.points, other) for one, other in zip(fetched, points, strict=True))
        require(same, f"the coordinates of step {self.step} differ from the undisturbed run's")

    def take_over(self) -> None:
        """Send RESUME while the old holder is connected; the old holder must be fenced."""
        self.connect()
        old, epoch = self._lines, self.epoch
        self._lines = []
        with ExitStack() as closing:
            for line in old:
                closing.enter_context(line)
            self.resume()
            self.connect()
            intruder = replace(self.new(Status, 0), epoch=epoch)
            old[0].send(intruder)
            reply = old[0].receive(intruder, SILENCE)
            require(reply is None or reply.type == "ERROR", f"the old holder was answered {reply}")

    def _move(self, given: list[Any], expected: list[Any] | None) -> None:
        """Make one iteration, and request its stored replies again."""
        moves = [
            self.new(Move, p, step=self.step + 1, frame="committed", displacement=given[p]) for p in range(PARTITIONS)
        ]
        for _ in range(2):
            moved = self.deliver(moves)
            for reply, rows in zip(moved, expected or [reply.displacement for reply in moved], strict=True):
                same = np.array_equal(reply.displacement, rows)
                require(same, f"MOVE of step {self.step + 1} is answered otherwise than in the undisturbed run")

    def _require_same(self, commits: list[SessionMessage], expected: list[bytes]) -> None:
        """Send requests; the replies' frames must be those of the undisturbed run."""
        replies = self.deliver(commits)
        same = [frames_of(reply) for reply in replies] == expected
        require(same, f"COMMIT of step {commits[0].sequence} is answered otherwise than in the undisturbed run")
