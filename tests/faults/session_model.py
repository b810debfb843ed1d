"""The behaviour of a session, written a second time from SPEC.md: a few values and rules, no journal, no numerics.

The model gets the same requests as a server, in the same order, and gives the expected replies; it also gets the
accidents of its process and its disk. It takes coordinates from the replies: the displacement plus the coordinates of
its frame must give the server's bits (section 7); from these coordinates it computes the digest of a committed state
(section 16).
"""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.faults.check import require
from tests.faults.expected import Answer, Asked, Codes, Share
from tests.faults.reply_book import Book, Entry
from tests.faults.session_table import ADMITTED, COLLECTIVE, DISK, OTHERS

Points = list[NDArray[np.float64]]


@dataclass(frozen=True)
class Snapshot:
    """A possible state after a crash: a step, its coordinates, and the COMMITs that made it, with its digest."""

    step: int
    committed: Points
    commits: Sequence[Asked] = ()
    digest: bytes = b""


class SessionModel:
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
        """Whether BUILT was sent, or a RESUME has shown that BUILD was executed."""
        return bool(self.committed)

    @property
    def gone(self) -> bool:
        return self.worker == "none" and self.may_be_found == [None]

    @property
    def complete(self) -> bool:
        """Whether all of the mesh is uploaded, and nothing twice."""
        return self.uploaded == [share.parts for share in self.shares]

    @property
    def spoilt(self) -> bool:
        return any(n > share.parts for n, share in zip(self.uploaded, self.shares, strict=True))

    @property
    def missing(self) -> list[int]:
        """Partitions that a collective request waits for."""
        return [p for p in range(len(self.shares)) if p not in self.waiting] if self.waiting else []

    def admits(self, operation: str) -> bool:
        """The cell of section 8's table; it is marked as visited."""
        self.visited.add((self.state, operation))
        return operation in ADMITTED[self.state].split()

    def book(self, client: bytes) -> Book:
        return self.books.setdefault(client, Book(self.kept))

    def digest(self, step: int, points: Points) -> bytes:
        """Section 16."""
        ids, first = np.unique(np.concatenate([share.ids for share in self.shares]), return_index=True)
        rows = np.concatenate(points)[first]
        head = np.array([step, len(ids), rows.shape[1]], dtype="<i8").tobytes()
        return hashlib.sha256(b"mesh-motion state 1\n" + head + rows.astype("<f8").tobytes()).digest()

    # --- what becomes of it ------------------------------------------------------------------------------------------

    def learn_durable(self, reply: Any) -> None:
        """Section 21: the durable step never decreases, and is the last step unless the level is "relaxed"."""
        durable = getattr(reply, "durable_step", reply.step)
        least = self.durable_step if self.level == "relaxed" else self.step
        require(
            least <= durable <= self.step,
            f"{reply.type} says durable step {durable}; {least} is the least, {self.step} made",
        )
        self.durable_step = durable
        self.may_be_found = [s for s in self.may_be_found if s is None or s.step >= durable]

    def all_is_durable(self) -> None:
        """Not after a failure of the disk: then CLOSED or RESUMED gives the durable step."""
        if self.built and self.state not in ("FROZEN", "FAILED"):
            self.durable_step, self.may_be_found = self.step, [Snapshot(self.step, self.committed)]

    def end(self, *, discard: bool) -> None:
        """The worker has ended normally; a built mesh stays."""
        if discard or not self.built:
            self.may_be_found = [None]
        self.forget()
        self.state, self.worker, self.trial, self.iteration = "CLOSED", "none", [], 0
        self.waiting = {}

    def forget(self) -> None:
        """Values that no worker knows any more; the next worker cannot know whether a trial was lost."""
        self.lost = "surely" if self.trial or self.lost == "surely" else "perhaps"
        for book in self.books.values():
            book.restart()

    def lose_trial(self, state: str) -> None:
        self.lost = "surely" if self.trial else self.lost
        self.state, self.trial, self.iteration = state, [], 0

    def abandon(self, *codes: str) -> list[Answer]:
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
        """All of them are refused, and a repeat is tried again."""
        for asked in all_asked:
            entry = Entry(asked.message.sequence, asked.content, executed=False, kind=asked.kind)
            self.book(asked.message.client).enter(entry, asked)
        return [self.refuse(asked, *codes) for asked in all_asked]

    # --- requests to the data endpoint -------------------------------------------------------------------------------

    def ask(self, asked: Asked, fault: str = "") -> list[Answer]:
        """Expected replies to a request during a fault of disk, server or power."""
        refusal = self._gate(asked)
        if refusal is not None:
            return [refusal]
        if asked.kind in ("UPLOAD", *COLLECTIVE):
            return self._once(asked, fault)
        answer: list[Answer] = {"JOIN": self._join, "FETCH": self._fetch, "STATUS": self._status, "CLOSE": self._close}[
            asked.kind
        ](asked)
        return answer

    def _gate(self, asked: Asked) -> Answer | None:
        """Check sender, session, epoch and connection."""
        message, state = asked.message, None
        may, code = OTHERS.get(asked.user, (asked.kind, ""))
        if asked.kind not in may.split():
            state = ""
        elif message.session != self.session:
            code = "NOT_FOUND"
        elif message.partition >= len(self.shares):
            code = "INVALID_ARGUMENT.VALUE"
        elif message.epoch != self.epoch:
            code = "ABORTED.FENCED"
        elif asked.kind == "JOIN":
            code = "" if message.token == self.token else "NOT_FOUND"
        elif asked.user == "owner" and self.joined.get(message.partition) != asked.peer:
            code = "UNAUTHENTICATED"
        else:
            code = ""
        return self.refuse(asked, code, state=state) if code else None

    def _unless_admitted(self, asked: Asked) -> Answer | None:
        if self.admits(asked.kind):
            return None
        return self.refuse(asked, *self.state_codes(asked.kind))

    def _join(self, asked: Asked) -> list[Answer]:
        refusal = self._unless_admitted(asked)
        if refusal:
            return [refusal]
        self.joined[asked.message.partition] = asked.peer
        self.state = "READY" if self.state == "SUSPENDED" else self.state
        self.unreported = False  # JOINED reports a disk that has failed
        nodes = len(self.shares[asked.message.partition].ids) if self.built else 0
        about = {"state": self.state, "step": self.step, "iteration": self.iteration, "nodes": nodes}
        return [Answer(asked, "JOINED", fields=about | {"partitions": len(self.shares)})]

    def _fetch(self, asked: Asked) -> list[Answer]:
        refusal = self._unless_admitted(asked)
        if refusal:
            return [refusal]
        p, what = asked.message.partition, asked.message.what
        points = self.committed[p] if what == "committed" else self.shares[p].points
        return [Answer(asked, "FETCHED", fields={"step": self.step, "points": points})]

    def _status(self, asked: Asked) -> list[Answer]:
        about = {"state": self.state, "step": self.step, "iteration": self.iteration, "waiting_for": self.missing}
        return [self._unless_admitted(asked) or Answer(asked, "STATUS_REPORT", fields=about, effect=self.learn_durable)]

    def _close(self, asked: Asked) -> list[Answer]:
        refusal = self._unless_admitted(asked)
        if refusal:
            return [refusal]
        partition, discard = asked.message.partition, self.discarded or asked.message.outcome == "discard"
        left = {} if asked.user == "admin" else {p: peer for p, peer in self.joined.items() if p != partition}
        if not left and self.disk_broken and (discard or not self.built):
            return [self.refuse(asked, DISK)]
        if self.unreported and asked.message.outcome == "keep":
            self.unreported = False
            return [self.refuse(asked, DISK)]
        answers = self.abandon("ABORTED")
        self.joined, self.discarded = left, discard
        if not left:
            self.end(discard=discard)
            answers = [replace(answer, fields={}) for answer in answers]  # before or after the end, both is true
        return [*answers, Answer(asked, "CLOSED", effect=self._closed)]

    def _closed(self, reply: Any) -> None:
        self.learn_durable(reply)
        require(reply.step == self.durable_step, f"CLOSED says step {reply.step}")

    # --- requests that are executed once -----------------------------------------------------------------------------

    def _once(self, asked: Asked, fault: str) -> list[Answer]:
        """Section 10, then the request itself."""
        message, book = asked.message, self.book(asked.message.client)
        verdict = book.verdict(message.sequence, asked.content)
        if verdict in ("ABORTED.CONFLICT", "ABORTED.STALE"):
            return [self.refuse(asked, verdict)]
        if isinstance(verdict, Entry):
            return [Answer(asked, verdict.type, fields=verdict.fields, same=verdict.reply, effect=verdict.keep)]
        if asked.kind == "UPLOAD":
            return self._upload(asked)
        waiting = self.waiting.get(message.partition)
        if waiting and (waiting.message.client, waiting.message.sequence) == (message.client, message.sequence):
            if waiting.content != asked.content:
                return [self.refuse(asked, "ABORTED.CONFLICT")]
            self.waiting[message.partition] = replace(waiting, peer=asked.peer)
            return []
        return self._collective(asked, fault)

    def _upload(self, asked: Asked) -> list[Answer]:
        p = asked.message.partition
        if p in self.waiting:
            return [self.refuse(asked, "FAILED_PRECONDITION")]
        if asked.wrong or not self.admits("UPLOAD"):
            codes = asked.wrong if self.admits("UPLOAD") else (*asked.wrong, *self.state_codes("UPLOAD"))
            return self.refuse_all([asked], *codes)
        self.uploaded[p] += 1
        self.state = "OPENING"
        return [self.executed(asked, "UPLOADED")]

    def _collective(self, asked: Asked, fault: str) -> list[Answer]:
        """Section 9: faults of one partition, waiting partitions, and the complete collective request."""
        p, others = asked.message.partition, {q: a for q, a in self.waiting.items() if q != asked.message.partition}
        codes = (*asked.wrong, *self._wrong_step(asked))
        if not self.admits(asked.kind):
            codes = (*codes, *self.state_codes(asked.kind))
        if codes:
            return self.refuse_all([asked], *codes)
        answers = [self.refuse(self.waiting[p], "ABORTED.STALE")] if p in self.waiting else []
        self.waiting = others | {p: asked}
        if any(_common(other) != _common(asked) for other in others.values()):
            return [*answers, *self.abandon("INVALID_ARGUMENT.PARTITION")]
        if len(self.waiting) < len(self.shares):
            return answers
        all_asked = [self.waiting[q] for q in sorted(self.waiting)]
        self.waiting = {}
        run = {"BUILD": self._build, "MOVE": self._move, "COMMIT": self._commit, "ROLLBACK": self._rollback}[asked.kind]
        return [*answers, *run(all_asked, fault)]

    def _wrong_step(self, asked: Asked) -> Codes:
        step = getattr(asked.message, "step", None)
        if step in (None, self.step + 1):
            return ()
        lost = self.reopened and self.level == "relaxed" and step > self.step + 1
        return ("ABORTED.STEPS_LOST",) if lost else ("FAILED_PRECONDITION.STEP",)

    def _build(self, all_asked: Sequence[Asked], fault: str) -> list[Answer]:
        if not self.complete:
            return self.refuse_all(all_asked, "INVALID_ARGUMENT")
        reference = [share.points for share in self.shares]
        if fault:
            self.may_be_found = [None, Snapshot(0, reference)]
            return self.refuse_all(all_asked, DISK)
        self.state, self.committed, self.may_be_found = "READY", reference, [Snapshot(0, reference)]
        return [
            self.executed(asked, "BUILT", step=0, moving_nodes=share.moving)
            for asked, share in zip(all_asked, self.shares, strict=True)
        ]

    def _move(self, all_asked: Sequence[Asked], _fault: str) -> list[Answer]:
        if not self._agree([asked.message.displacement for asked in all_asked]):
            return self.refuse_all(all_asked, "INVALID_ARGUMENT.PARTITION")
        if any(asked.far for asked in all_asked):
            return self.refuse_all(all_asked, "FAILED_PRECONDITION.QUALITY")
        self.state, self.lost, self.iteration = "TRIAL", "no", self.iteration + 1
        self.trial = list(self.committed)
        about: dict[str, Any] = {"step": self.step + 1, "iteration": self.iteration}
        frame = all_asked[0].message.frame
        inputs = (self.digest(self.step, self.committed), frame, *(a.message.displacement.tobytes() for a in all_asked))
        return [self.executed(a, "MOVED", partial(self._take_motion, a, inputs), **about) for a in all_asked]

    def _agree(self, rows: Sequence[NDArray[np.float64]]) -> bool:
        ids = np.concatenate([share.ids[share.moving] for share in self.shares])
        given = np.concatenate(rows)
        _, first, inverse = np.unique(ids, return_index=True, return_inverse=True)
        return bool(np.array_equal(given, given[first][inverse]))

    def _take_motion(self, asked: Asked, inputs: Any, reply: Any) -> None:
        """Section 7: a pure function; prescribed displacements, and sums equal to the server's coordinates."""
        p, share = asked.message.partition, self.shares[asked.message.partition]
        base = share.points if asked.message.frame == "reference" else self.committed[p]
        require(
            np.array_equal(reply.displacement[share.moving], asked.message.displacement), "moving nodes are elsewhere"
        )
        again = self._moved.setdefault((inputs, p), reply.displacement.tobytes())
        require(again == reply.displacement.tobytes(), "the same MOVE is answered with another displacement")
        along = asked.message.headroom_along if asked.message.report else ""
        require(reply.headroom.get("along", "") == along, f"the headroom is that of {reply.headroom}, not {along!r}")
        self.trial[p] = base + reply.displacement

    def _commit(self, all_asked: Sequence[Asked], fault: str) -> list[Answer]:
        digest = self.digest(self.step + 1, self.trial)
        after = Snapshot(self.step + 1, self.trial, all_asked, digest)
        if self.level == "relaxed":
            return self._commit_relaxed(all_asked, after, fault)
        if fault:
            self.may_be_found = [*self.may_be_found, after]
            self.state = "FAILED" if fault == "defect" else "FROZEN"
            if fault == "defect":
                self.trial, self.iteration = [], 0
            return self.refuse_all(all_asked, "INTERNAL" if fault == "defect" else DISK)
        self.state, self.iteration = "READY", 0
        self.step, self.committed, self.trial = after.step, after.committed, []
        self.may_be_found = [Snapshot(self.step, self.committed)]
        about: dict[str, Any] = {"step": self.step, "durable_step": self.step, "digest": digest}
        return [self.executed(asked, "COMMITTED", self.learn_durable, **about) for asked in all_asked]

    def _commit_relaxed(self, all_asked: Sequence[Asked], after: Snapshot, fault: str) -> list[Answer]:
        """Answered at once; steps after the last durable step of a reply may be lost."""
        self.state, self.iteration, self.trial = "READY", 0, []
        self.step, self.committed = after.step, after.committed
        self.may_be_found = [*self.may_be_found, replace(after, commits=())]
        about: dict[str, Any] = {"step": self.step, "digest": after.digest}
        answers = [self.executed(asked, "COMMITTED", self.learn_durable, **about) for asked in all_asked]
        if fault == "disk":
            self.state, self.unreported = "FROZEN", True
        return answers

    def _rollback(self, all_asked: Sequence[Asked], _fault: str) -> list[Answer]:
        self.state, self.trial, self.iteration, self.lost = "READY", [], 0, "no"
        return [self.executed(asked, "ROLLED_BACK", step=self.step) for asked in all_asked]

    # --- what happens to it ------------------------------------------------------------------------------------------

    def lease_ends(self) -> list[Answer]:
        self.admits("LEASE_END")
        self.unreported = False
        self.all_is_durable()
        if self.state in ("READY", "TRIAL"):
            self.lose_trial("SUSPENDED")
        abandoned = self.abandon("ABORTED")
        if self.state in ("NEW", "OPENING"):
            self.end(discard=True)
        return abandoned

    def time_out(self) -> list[Answer]:
        """The requests that wait for other partitions have reached their time limit."""
        return self.abandon("DEADLINE_EXCEEDED")

    def ends(self) -> None:
        """The server stops: the worker closes its journal; no waiting client gets an answer."""
        self.all_is_durable()
        self.end(discard=False)

    def crashes(self, worker: str) -> None:
        """The process has ended; PROBE gives this worker state."""
        self.state, self.worker, self.unreported = "", worker, False
        self.joined, self.waiting = {}, {}
        self.forget()
        self.trial, self.iteration = [], 0

    # --- RESUME and PROBE --------------------------------------------------------------------------------------------

    def gate_control(self, asked: Asked) -> Answer | None:
        """Check sender and token for an existing session."""
        may, code = OTHERS.get(asked.user, (asked.kind, ""))
        if asked.kind not in may.split():
            return self.refuse(asked, code, state="")
        if self.gone or (asked.user == "owner" and asked.message.token != self.token):
            return self.refuse(asked, "NOT_FOUND", state="")
        return None

    def resume(self, asked: Asked, fault: str = "") -> Answer:
        if self.worker == "alive" and self.admits("RESUME"):
            if not (fault and self.built):
                state = self.state if not self.built else "READY"
                return Answer(asked, "RESUMED", fields={"epoch": self.epoch + 1}, effect=partial(self._resumed, state))
            self.lose_trial("FROZEN")
        if self.worker == "alive":
            self.crashes("dead")
        if self.may_be_found == [None]:
            self.worker = "none"
            return self.refuse(asked, "NOT_FOUND", state="")
        perhaps = ("NOT_FOUND",) if None in self.may_be_found else ()
        if fault:
            return Answer(asked, "ERROR", (DISK, *perhaps), {"state": ""}, effect=self._found)
        return Answer(asked, "RESUMED", perhaps, effect=self._found)

    def _resumed(self, state: str, reply: Any) -> None:
        """By the worker that lives."""
        require((reply.state, reply.step) == (state, self.step), f"RESUMED says {reply.state} at step {reply.step}")
        self.epoch, self.joined, self.waiting, self.discarded = reply.epoch, {}, {}, False
        self.all_is_durable()
        if self.built:
            self.lose_trial("READY")
            self.lost = "surely" if self.lost == "surely" else "perhaps"

    def _found(self, reply: Any) -> None:
        """RESUME from the journal, or a refusal."""
        if reply.type == "ERROR":
            self.may_be_found, self.worker = [None] if reply.code == "NOT_FOUND" else self.may_be_found, "none"
            return
        require(reply.epoch > self.epoch, f"epoch {reply.epoch} after {self.epoch}")
        found = [snapshot for snapshot in self.may_be_found if snapshot and snapshot.step == reply.step]
        require(found, f"RESUMED says step {reply.step}, {self.step} was committed")
        snapshot = found[0]
        require(snapshot is not None and reply.state == "READY", f"RESUMED says {reply.state}")
        self.state, self.worker, self.epoch, self.joined = "READY", "alive", reply.epoch, {}
        self.discarded, self.reopened = False, True
        self._adopt(snapshot)

    def _adopt(self, snapshot: Any) -> None:
        """This state was durable; if a COMMIT made it, that COMMIT was executed."""
        self.durable_step = snapshot.step
        for book in self.books.values():
            book.forget_steps_after(snapshot.step)
        self.step, self.committed, self.may_be_found = (
            snapshot.step,
            snapshot.committed,
            [replace(snapshot, commits=())],
        )
        about = {"step": snapshot.step, "durable_step": snapshot.step, "digest": snapshot.digest}
        if snapshot.commits:
            self.lost = "perhaps"
        for asked in snapshot.commits:
            self.executed(asked, "COMMITTED", **about)


def _common(asked: Asked) -> Any:
    return asked.kind, getattr(asked.message, "step", None), getattr(asked.message, "frame", None)
