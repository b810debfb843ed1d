"""Level ``relaxed``: a commit is answered before it is on the disk; a thread of the session's process stores it.

The thread stores one state at a time, always the newest, with the replies to all commits since the last one stored
(:class:`Backlog`). So the disk's queue never grows: at most two states wait, and the durable step lacks only the
commits of the last two writes. A crash of the process loses as much as a loss of power.
"""

import threading
from collections.abc import Callable

from mesh_motion_numerics.arrays import Floats
from mesh_motion_protocol.errors import DataLoss

from mesh_motion_server.session.journal.files import KEPT_COMMITS
from mesh_motion_server.session.journal.journal import Journal
from mesh_motion_server.session.journal.keeper import Keeper
from mesh_motion_server.session.journal.ledger import BoundaryInput, Commit


class Backlog:
    """Answered commits that are not stored yet: the newest state, and the replies that are kept."""

    def __init__(self, journal: Journal) -> None:
        self._journal = journal
        self._commits: tuple[Commit, ...] = ()
        self._state: Floats | None = None

    def __len__(self) -> int:
        return len(self._commits)

    def accept(self, entry: Commit, state: Floats) -> None:
        """Add a commit; its state (n, d) never changes."""
        self._commits, self._state = (*self._commits, entry)[-KEPT_COMMITS:], state

    def take(self) -> Callable[[], None]:
        """Empty the backlog; return the call that stores its content."""
        (*earlier, entry), state = self._commits, self._state
        self._commits, self._state = (), None
        if state is None:
            raise DataLoss("there is nothing to store", code="INTERNAL")
        return lambda: self._journal.store(entry, state, earlier)


class RelaxedKeeper(Keeper):
    """Level ``relaxed``; its methods are called by one thread.

    Parameters
    ----------
    journal : Journal
        Used only by this keeper's thread while there are commits to store.
    """

    def __init__(self, journal: Journal) -> None:
        super().__init__(journal)
        self._commits = journal.ledger.commits
        self._backlog = Backlog(journal)
        self._failure: DataLoss | None = None
        self._storing = self._over = False
        self._news = threading.Condition()
        self._thread: threading.Thread | None = None

    @property
    def commits(self) -> tuple[Commit, ...]:
        return self._commits

    def durable_after(self, step: int) -> int:
        del step
        return self.durable_step

    def prepare(self, state: Floats) -> None:
        """See :class:`Keeper`: commits are stored after their answers."""

    def commit(self, entry: Commit, state: Floats, boundary: Callable[[], BoundaryInput]) -> None:
        del boundary
        if self._thread is None:
            thread = threading.Thread(target=self._run, name="relaxed commits", daemon=True)
            thread.start()  # first: if there is no memory for a thread, no commit is taken
            self._thread = thread
        with self._news:
            self._require_working()
            self._backlog.accept(entry, state)
            self._news.notify_all()
        self._commits = (*self._commits, entry)[-KEPT_COMMITS:]

    def catch_up(self) -> None:
        with self._news:
            self._news.wait_for(lambda: self._failure is not None or not (self._backlog or self._storing))
            self._require_working()

    def rest(self, state: Callable[[], Floats]) -> None:
        del state
        self.catch_up()

    def close(self) -> None:
        with self._news:
            self._over = True
            self._news.notify_all()
        if self._thread is not None:
            self._thread.join()
        super().close()

    def _require_working(self) -> None:
        if self._failure is not None:
            failure = self._failure
            raise DataLoss(failure.message, code=failure.code, hint=failure.hint, details=failure.details)

    def _run(self) -> None:
        """Store new commits until the session is closed or the disk fails."""
        while True:
            with self._news:
                self._news.wait_for(lambda: self._over or self._backlog)
                if self._over:
                    return
                store, self._storing = self._backlog.take(), True
            failure = _failure_of(store)
            with self._news:
                self._storing, self._failure = False, failure
                self._news.notify_all()
            if failure is not None:
                return


def _failure_of(store: Callable[[], None]) -> DataLoss | None:
    """Call ``store``; return its error, if any."""
    try:
        store()
    except DataLoss as error:
        return error
    except Exception as error:
        return DataLoss(f"unexpected {type(error).__name__}: {error}", code="INTERNAL")
    return None
