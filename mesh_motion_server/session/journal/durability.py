"""The levels of durability: the condition that a commit waits for, and the state that a restart restores.

``full``
    Every commit stores its state: a slot and a record, two syncs.
``replay``
    A commit stores the input of its state in a record: one sync, and as many bytes as the boundary takes. Every
    ``snapshot_steps`` commits, or after ``log_bytes`` of log or a minute, a commit stores its state instead; so does a
    commit whose input is so large, compared with the state, that the log would cost the disk as much. Opening the
    journal recomputes the states after the last stored one (:mod:`~mesh_motion_server.session.replay`): about a
    minute's work. No answered commit is lost, as with ``full``. Closing stores the state, so that after a planned
    restart, or with another version of the server, nothing must be recomputed.
``relaxed``
    A commit is answered at once; states are stored later (:mod:`.relaxed`). Answered steps after the durable step may
    be lost.
"""

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace

from mesh_motion_numerics.arrays import Floats
from mesh_motion_protocol.errors import DataLoss

from mesh_motion_server.session.journal.journal import Journal
from mesh_motion_server.session.journal.keeper import Keeper
from mesh_motion_server.session.journal.ledger import BoundaryInput, Commit
from mesh_motion_server.session.journal.relaxed import RelaxedKeeper

_LOG = logging.getLogger(__name__)

#: Smallest and largest number of bytes of commits that are logged before a state is stored: opening reads all of them.
_LEAST_LOG, _MOST_LOG = 1 << 20, 32 << 20
#: An input is logged if it has at most this many bytes, or is at most this share of the state (benchmarks.durability).
_SMALL_INPUT, _SMALL_PART = 256 << 10, 1 / 32
#: Seconds after which the next state is stored: recomputing the steps logged in the meantime takes no longer, and a
#: worker that resumes a session has ten minutes, even if its moves are slow.
_LONGEST_LOG = 60.0


def log_bytes(state_bytes: int) -> int:
    """The number of bytes of logged commits after which a state of this size is stored: half of the state's bytes."""
    return min(max(state_bytes // 2, _LEAST_LOG), _MOST_LOG)


class FullKeeper(Keeper):
    """Level ``full``."""

    @property
    def commits(self) -> tuple[Commit, ...]:
        return self.journal.ledger.commits

    def durable_after(self, step: int) -> int:
        return step

    def prepare(self, state: Floats) -> None:
        self.journal.write_ahead(state)

    def commit(self, entry: Commit, state: Floats, boundary: Callable[[], BoundaryInput]) -> None:
        del boundary
        self.journal.store(entry, state)

    def catch_up(self) -> None:
        """See :class:`Keeper`."""

    def rest(self, state: Callable[[], Floats]) -> None:
        """See :class:`Keeper`."""


class ReplayKeeper(FullKeeper):
    """Level ``replay``."""

    def prepare(self, state: Floats) -> None:
        """See :class:`Keeper`: few states are stored."""

    def __init__(self, journal: Journal) -> None:
        super().__init__(journal)
        self._logged_bytes = sum(_bytes_of(commit) for commit in journal.ledger.logged)
        self._logged_since = time.monotonic()

    def commit(self, entry: Commit, state: Floats, boundary: Callable[[], BoundaryInput]) -> None:
        ledger, foundation = self.journal.ledger, self.journal.ledger.foundation
        logged = replace(entry, boundary=boundary())
        total, largest = self._logged_bytes + _bytes_of(logged), max(_SMALL_INPUT, _SMALL_PART * state.nbytes)
        small = _bytes_of(logged) <= largest and total <= foundation.log_bytes
        recent = time.monotonic() - self._logged_since < _LONGEST_LOG
        if small and recent and len(ledger.logged) + 1 < foundation.snapshot_steps:
            self.journal.log(logged)
            self._logged_bytes = total
        else:
            self.journal.store(entry, state)
            self._logged_bytes, self._logged_since = 0, time.monotonic()

    def rest(self, state: Callable[[], Floats]) -> None:
        if self.journal.ledger.logged:
            self.journal.snapshot(state())
            self._logged_bytes = 0


def _bytes_of(commit: Commit) -> int:
    """Bytes of a logged commit in a checkpoint: its input, and a generous share for all other data."""
    rows = commit.boundary.rows if commit.boundary is not None else b""
    return len(rows) + len(commit.receipt) + 128 * len(commit.requests) + 512


def keeper_of(journal: Journal) -> Keeper:
    """The keeper of a journal's level."""
    durability = journal.ledger.foundation.durability
    if durability == "relaxed":
        return RelaxedKeeper(journal)
    return ReplayKeeper(journal) if durability == "replay" else FullKeeper(journal)


@contextmanager
def logged_failure(session: str) -> Iterator[None]:
    """Log a failure for which no client waits; the next request is refused."""
    try:
        yield
    except DataLoss as error:
        _LOG.error("session %s could not be stored: %s", session, error)
