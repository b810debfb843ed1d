"""Steps for ever, as somebody asks for: ``python -m tests.faults.soak_client ENDPOINT SEED PARENT``.

Three sessions are held: one by the Python client, one by hand, whose requests are often sent twice and whose
connection is cut often, and one with the real numerics. For each line of standard input, a number of steps, so many are
made, in random order over the three; then a line with the session ids' steps goes to standard output. Meanwhile holders
rejoin and resume, sessions are opened and discarded, closed and resumed, lists and reports are asked for.
"""

import contextlib
import os
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable
from random import Random

import numpy as np
from mesh_motion_client import MeshMotionError, connect
from mesh_motion_client.session import Session

from tests.faults.check import require
from tests.faults.client_mesh import client_mesh
from tests.faults.holder import Holder, seeded_mesh, seeded_rows
from tests.faults.stand_in_service import REAL

#: What comes once in so many steps: another connection, another epoch, a session that comes and goes, a list.
REJOINS, RESUMES, SHORT_LIVED, LISTS = 80, 80, 500, 200
#: A session rests, and comes back in another worker, once in so many short-lived ones.
_RESTS = 2
_REHEARSED = 50
_OPEN_SECONDS = 300.0
#: Between two looks at whether the proof still runs, seconds.
_LOOKS = 1.0


class Soaker:
    """The three sessions and what is done with them.

    ``done``: what was done, by name.
    """

    def __init__(self, endpoint: str, seed: int) -> None:
        self.random, self.done, self._endpoint = Random(f"soak {seed}"), Counter[str](), endpoint
        self._server = connect(endpoint, timeout=_OPEN_SECONDS, compute_timeout=_OPEN_SECONDS)
        self._client = self._server.open(client_mesh(seeded_mesh(1)), {"support_radius": 2.0})
        self._by_hand, self._real = Holder(endpoint, 2), Holder(endpoint, 3)
        self._by_hand.open()
        self._real.open(REAL)
        self._ways: tuple[tuple[Callable[[], None], int], ...] = (
            (self._client_step, 50),
            (self._step_by_hand, 45),
            (self._real_step, 5),
        )

    def rehearse(self) -> None:
        """Everything once and some steps: what is loaded or made once is there before memory is looked at."""
        for act in (self._short_lived, self._short_lived, self._rejoin, self._resume, self._look, self._real_step):
            act()
        for _ in range(_REHEARSED):
            self._client_step()
            self._step_by_hand()

    def go(self, steps: int) -> None:
        """So many steps, and what comes between them."""
        for _ in range(steps):
            (way,) = self.random.choices([way for way, _ in self._ways], [weight for _, weight in self._ways])
            way()
            self.done["steps"] += 1
            self._between()

    def _between(self) -> None:
        """Now and then."""
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
        # The first iteration's rows come last: those are what the next step undoes, and the boundary stays where it is.
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
        """Another connection, under the same epoch."""
        self._by_hand.join()
        self._replace(self._server.join(self._client.credentials, partition=0))

    def _resume(self) -> None:
        """Another holder, under the next epoch."""
        self._by_hand.resume()
        self._replace(self._server.resume(self._client.credentials))

    def _replace(self, session: Session) -> None:
        """A new session object instead of the old one, which has nothing left to say."""
        old, self._client = self._client, session
        with contextlib.suppress(MeshMotionError):
            old.close()

    def _short_lived(self) -> None:
        """A session that comes and goes; some rest in between."""
        holder = Holder(self._endpoint, self.done["short-lived sessions"])
        holder.open("short-lived")
        holder.move()
        holder.commit()
        if self.random.randrange(_RESTS) == 0:
            holder.close()
            holder.resume()
        holder.close("discard")

    def _look(self) -> None:
        """Lists, reports and coordinates."""
        require(len(self._server.sessions()) >= 3, "LIST has lost a session")
        require(self._client.status().step == self._client.step, "STATUS says another step")
        require(bool(np.isfinite(self._client.points()).all()), "FETCH has lost the coordinates")
        self._by_hand.status()
        self._real.points()

    def close(self) -> None:
        """Discard the sessions."""
        self._client.close("discard")
        self._by_hand.close("discard")
        self._real.close("discard")
        self._server.close()


def _end_with(proof: int) -> None:
    """A proof that is interrupted while it starts this process does not know of it yet: nothing else would end it."""

    def watch() -> None:
        while os.getppid() == proof:
            time.sleep(_LOOKS)
        os._exit(1)

    threading.Thread(target=watch, name="proof", daemon=True).start()


def main(endpoint: str, seed: str, proof: str) -> None:
    """Obey standard input; ``proof`` is the process that starts this one."""
    _end_with(int(proof))
    soaker = Soaker(endpoint, int(seed))
    soaker.rehearse()
    _say(soaker.done)
    for line in sys.stdin:
        soaker.go(int(line))
        _say(soaker.done)
    soaker.close()


def _say(done: Counter[str]) -> None:
    sys.stdout.write(" ".join(f"{name.replace(' ', '-')}={count}" for name, count in done.items()) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main(*sys.argv[1:])
