"""What a session is and knows, written once more from SPEC.md: state, step, who waits, what may be found later."""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.faults.check import require
from tests.faults.expected import Answer, Asked, Codes, Share
from tests.faults.reply_book import Book, Entry
from tests.faults.session_table import ADMITTED, DISK

Points = list[NDArray[np.float64]]


@dataclass(frozen=True)
class Snapshot:
    """What may be found after a crash: a step, its coordinates, and the COMMITs that made it, with its digest."""

    step: int
    committed: Points
    commits: Sequence[Asked] = ()
    digest: bytes = b""


class SessionState:
    """One session.

    ``shares``: by partition; ``kept``: ``stored_replies``; ``level``: of durability.
    """

    def __init__(self, opened: Any, shares: Sequence[Share], kept: int, level: str = "full") -> None:
        self.session, self.token, self.epoch = opened.session, opened.token, int(opened.epoch)
        self.shares, self.kept, self.level = shares, kept, level
        self.durable_step, self.reopened, self.unreported = 0, False, False
        self.state, self.worker, self.step, self.iteration = "NEW", "alive", 0, 0
        self.lost = "no"
        self.joined: dict[int, bytes] = {}
        self.uploaded = [0] * len(shares)
        self.waiting: dict[int, Asked] = {}
        self.books: dict[bytes, Book] = {}
        self.committed: Points = []
        self.trial: Points = []
        self.may_be_found: list[Snapshot | None] = [None]
        self.disk_broken = False
        self.visited: set[tuple[str, str]] = set()
        self.discarded = False
        self._moved: dict[Any, bytes] = {}

    # --- what it knows -----------------------------------------------------------------------------------------------

    @property
    def built(self) -> bool:
        """Whether BUILT was answered, or a RESUME has found that it should have been."""
        return bool(self.committed)

    @property
    def gone(self) -> bool:
        """Whether no client will find it again."""
        return self.worker == "none" and self.may_be_found == [None]

    @property
    def complete(self) -> bool:
        """Whether all of the mesh is uploaded, and nothing twice."""
        return self.uploaded == [share.parts for share in self.shares]

    @property
    def spoilt(self) -> bool:
        """Whether something is uploaded twice."""
        return any(n > share.parts for n, share in zip(self.uploaded, self.shares, strict=True))

    @property
    def missing(self) -> list[int]:
        """Partitions that a collective request waits for."""
        return [p for p in range(len(self.shares)) if p not in self.waiting] if self.waiting else []

    def admits(self, operation: str) -> bool:
        """The cell of section 8's table; it is now visited."""
        self.visited.add((self.state, operation))
        return operation in ADMITTED[self.state].split()

    def book(self, client: bytes) -> Book:
        """The requests of a client."""
        return self.books.setdefault(client, Book(self.kept))

    def digest(self, step: int, points: Points) -> bytes:
        """Section 16."""
        ids, first = np.unique(np.concatenate([share.ids for share in self.shares]), return_index=True)
        rows = np.concatenate(points)[first]
        head = np.array([step, len(ids), rows.shape[1]], dtype="<i8").tobytes()
        return hashlib.sha256(b"mesh-motion state 1\n" + head + rows.astype("<f8").tobytes()).digest()

    # --- what becomes of it ------------------------------------------------------------------------------------------

    def learn_durable(self, reply: Any) -> None:
        """Section 21: it never goes back, and is the last step unless the level is "relaxed"."""
        durable = getattr(reply, "durable_step", reply.step)
        least = self.durable_step if self.level == "relaxed" else self.step
        require(
            least <= durable <= self.step,
            f"{reply.type} says durable step {durable}; {least} is the least, {self.step} made",
        )
        self.durable_step = durable
        self.may_be_found = [s for s in self.may_be_found if s is None or s.step >= durable]

    def all_is_durable(self) -> None:
        """Unless the disk has failed: then CLOSED or RESUMED says what is durable."""
        if self.built and self.state not in ("FROZEN", "FAILED"):
            self.durable_step, self.may_be_found = self.step, [Snapshot(self.step, self.committed)]

    def end(self, *, discard: bool) -> None:
        """The worker has ended as it should; what is built stays."""
        if discard or not self.built:
            self.may_be_found = [None]
        self.forget()
        self.state, self.worker, self.trial, self.iteration = "CLOSED", "none", [], 0
        self.waiting = {}

    def forget(self) -> None:
        """What no worker knows any more; a trial may have been lost, for all that the next one knows."""
        self.lost = "surely" if self.trial or self.lost == "surely" else "perhaps"
        for book in self.books.values():
            book.restart()

    def lose_trial(self, state: str) -> None:
        self.lost = "surely" if self.trial else self.lost
        self.state, self.trial, self.iteration = state, [], 0

    def abandon(self, *codes: str) -> list[Answer]:
        """Everyone who waits is refused."""
        waiting, self.waiting = self.waiting, {}
        return [self.refuse(waiting[p], *codes) for p in sorted(waiting)]

    # --- what it answers ---------------------------------------------------------------------------------------------

    def refuse(self, asked: Asked, *codes: str, state: str | None = None) -> Answer:
        return Answer(asked, "ERROR", codes, {"state": self.state if state is None else state})

    def state_codes(self, kind: str) -> Codes:
        if self.state == "FROZEN":
            self.unreported = False
            return (DISK,)
        if kind == "COMMIT" and self.state == "READY" and self.lost != "no":
            return ("ABORTED.TRIAL_LOST", *(["FAILED_PRECONDITION.STATE"] if self.lost == "perhaps" else []))
        return ("FAILED_PRECONDITION.STATE",)

    def executed(
        self, asked: Asked, kind: str, effect: Callable[[Any], None] = lambda _: None, **fields: Any
    ) -> Answer:
        entry = Entry(asked.message.sequence, asked.content, executed=True, type=kind, fields=fields, kind=asked.kind)
        self.book(asked.message.client).enter(entry, asked)

        def keep(reply: Any) -> None:
            entry.keep(reply)
            effect(reply)

        return Answer(asked, kind, fields=fields, effect=keep)

    def refuse_all(self, all_asked: Sequence[Asked], *codes: str) -> list[Answer]:
        """They are refused alike, and tried again when they are repeated."""
        for asked in all_asked:
            entry = Entry(asked.message.sequence, asked.content, executed=False, kind=asked.kind)
            self.book(asked.message.client).enter(entry, asked)
        return [self.refuse(asked, *codes) for asked in all_asked]
