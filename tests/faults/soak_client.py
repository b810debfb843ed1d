"""Makes steps while they are requested over a pipe of multiprocessing.

It holds three sessions: one with the Python client, one with its own code that often repeats requests and cuts its
connection, and one with the real numerics. Steps are made in random order over the three. Meanwhile holders rejoin and
resume, sessions are opened and discarded, closed and resumed, and lists and reports are requested.
"""

import contextlib
import traceback
from collections import Counter
from collections.abc import Callable
from multiprocessing.connection import Connection
from random import Random
from types import SimpleNamespace

import numpy as np
from mesh_motion_client import MeshMotionError, connect
from mesh_motion_client.session import Session
from mesh_motion_protocol import messages as m

from tests.faults.check import require
from tests.faults.client_mesh import client_mesh
from tests.faults.holder import SeededHolder, seeded_mesh, seeded_rows
from tests.faults.processes import end_with_parent
from tests.faults.stand_in_service import REAL

#: Events, each once in so many steps: another connection, another epoch, a session that comes and goes, a list.
REJOINS, RESUMES, SHORT_LIVED, LISTS = 80, 80, 500, 200
#: A session rests, and comes back in another worker, once in so many short-lived ones.
_RESTS = 2
_REHEARSED = 50
_OPEN_SECONDS = 300.0


class Soaker:
    """The three sessions and the work with them.

    ``done``: counts of the work, by name.
    """

    def __init__(self, endpoint: str, seed: int) -> None:
        self.random, self.done, self._there = Random(f"soak {seed}"), Counter[str](), SimpleNamespace(endpoint=endpoint)
        self._server = connect(endpoint, timeout=_OPEN_SECONDS, compute_timeout=_OPEN_SECONDS)
        self._client = self._server.open(client_mesh(seeded_mesh(1)), {"support_radius": 2.0})
        self._by_hand, self._real = SeededHolder(self._there, 2), SeededHolder(self._there, 3)
        self._by_hand.open()
        self._real.open(label=REAL, settings={"support_radius": 2.0})
        self._ways: tuple[tuple[Callable[[], None], int], ...] = (
            (self._client_step, 50),
            (self._step_by_hand, 45),
            (self._real_step, 5),
        )

    def rehearse(self) -> None:
        """Do everything once and make some steps: then all modules and caches exist before memory is measured."""
        for act in (self._short_lived, self._short_lived, self._rejoin, self._resume, self._look, self._real_step):
            act()
        for _ in range(_REHEARSED):
            self._client_step()
            self._step_by_hand()

    def go(self, steps: int) -> None:
        for _ in range(steps):
            (way,) = self.random.choices([way for way, _ in self._ways], [weight for _, weight in self._ways])
            way()
            self.done["steps"] += 1
            self._between()

    def _between(self) -> None:
        for name, one_in, act in (
            ("rejoins", REJOINS, self._rejoin),
            ("resumes", RESUMES, self._resume),
            ("short-lived sessions", SHORT_LIVED, self._short_lived),
            ("lists", LISTS, self._look),
        ):
            if self.random.randrange(one_in) == 0:
                act()
                self.done[name] += 1

    def _client_step(self) -> None:
        session = self._client
        # The first iteration's rows come last: the next step undoes them, so the boundary stays in place.
        for iteration in range(self.random.choice((1, 1, 1, 2)), 0, -1):
            rows = seeded_rows(1, session.step + 1, iteration, len(session.moving_nodes))
            session.move(rows, frame="committed")
        if self.random.random() < 0.05:
            session.rollback()
            session.move(seeded_rows(1, session.step + 1, 1, len(session.moving_nodes)), frame="committed")
        session.commit()

    def _step_by_hand(self) -> None:
        self._by_hand.move(repeats=self.random.choice((0, 0, 1)))
        if self.random.random() < 0.05:
            self._by_hand.rollback()
            self._by_hand.move()
        self._by_hand.commit(repeats=self.random.choice((0, 0, 1)))

    def _real_step(self) -> None:
        self._real.move()
        self._real.commit()

    def _rejoin(self) -> None:
        self._by_hand.join()
        self._replace(self._server.join(self._client.credentials, partition=0))

    def _resume(self) -> None:
        self._by_hand.come_back()
        self._replace(self._server.resume(self._client.credentials))

    def _replace(self, session: Session) -> None:
        """A new session object replaces the old one."""
        old, self._client = self._client, session
        with contextlib.suppress(MeshMotionError):
            old.close()

    def _short_lived(self) -> None:
        """Open and end a session; sometimes it rests in between."""
        holder = SeededHolder(self._there, self.done["short-lived sessions"])
        holder.open(label="short-lived")
        holder.move()
        holder.commit()
        if self.random.randrange(_RESTS) == 0:
            holder.leave()
            holder.come_back()
        holder.leave("discard")

    def _look(self) -> None:
        require(len(self._server.sessions()) >= 3, "LIST has lost a session")
        require(self._client.status().step == self._client.step, "STATUS says another step")
        require(bool(np.isfinite(self._client.points()).all()), "FETCH has lost the coordinates")
        self._by_hand.request(m.Status)
        self._real.request(m.Fetch)

    def close(self) -> None:
        self._client.close("discard")
        self._by_hand.leave("discard")
        self._real.leave("discard")
        self._server.close()


def main(endpoint: str, seed: int, line: Connection) -> None:
    """Make the number of steps that each message gives, and return the counts; the last message gives the reason of the
    end.
    """
    end_with_parent()
    try:
        soaker = Soaker(endpoint, seed)
        soaker.rehearse()
        while True:
            line.send({"steps": 0} | soaker.done)
            try:
                steps = line.recv()
            except EOFError:
                break
            soaker.go(steps)
        soaker.close()
    except Exception:
        line.send(traceback.format_exc())
