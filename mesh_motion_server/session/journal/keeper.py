"""The interface of every level of durability; each level implements it in its own way."""

from abc import ABC, abstractmethod
from collections.abc import Callable

from mesh_motion_numerics.arrays import Floats

from mesh_motion_server.session.journal.journal import Journal
from mesh_motion_server.session.journal.ledger import BoundaryInput, Commit


class Keeper(ABC):
    """Keeps the commits of a session, at one of the levels that :mod:`.durability` lists."""

    def __init__(self, journal: Journal) -> None:
        self.journal = journal

    @property
    @abstractmethod
    def commits(self) -> tuple[Commit, ...]:
        """The latest commits, durable or not."""

    @property
    def durable_step(self) -> int:
        """A power loss never takes the session back to a step before this one.

        The ledger is replaced as a whole after its content is synced, so any thread may read it.
        """
        return self.journal.ledger.step

    @property
    def frozen(self) -> bool:
        """Whether the disk failed, possibly in the background."""
        return self.journal.frozen

    @abstractmethod
    def durable_after(self, step: int) -> int:
        """The durable step in the answer to a commit of ``step``."""

    @abstractmethod
    def prepare(self, state: Floats) -> None:
        """Announce the state (n, d) of the next commit, which never changes; the level may begin to write it.

        Raises DataLoss as :meth:`commit`.
        """

    @abstractmethod
    def commit(self, entry: Commit, state: Floats, boundary: Callable[[], BoundaryInput]) -> None:
        """Take a commit: its state (n, d), ascending by global id, which never changes, and the input of this state.

        Raises DataLoss if the disk failed, or has failed before.
        """

    @abstractmethod
    def catch_up(self) -> None:
        """Return when all commits are durable. Raises DataLoss if the disk failed, or has failed before."""

    @abstractmethod
    def rest(self, state: Callable[[], Floats]) -> None:
        """Catch up and leave nothing to recompute: the session is about to be closed.

        Raises DataLoss as :meth:`catch_up`.
        """

    def close(self) -> None:
        """Close the files; commits that are not durable yet are lost. Idempotent."""
        self.journal.close()
