"""Bad inputs against a session: each has to be answered by the right typed error, and leave no trace.

A case spoils a good session's requests in one place. What is judged:

- the refused request, and no other, is answered by ERROR with the case's code, ``retryable`` and the state before; the
  message and the details name the first offender, the hint the way out; no library warned behind it;
- the session is as before: a good request gives, bitwise, what it gives in a session that never saw the bad one, and
  so does the digest of the committed state. Where a bad mesh was sent, which cannot be taken back, the same BUILD is
  refused in the same words, and CLOSE is answered.

The rows are in :mod:`tests.faults.inputs`; :func:`prove_bad_inputs` runs them, with the places they spoil
drawn from ``seed``.
"""

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from mesh_motion_protocol.errors import error_code
from mesh_motion_protocol.messages import ErrorReply, Message

from mesh_motion_server.session.store import SessionStore
from tests.faults.inputs.bad_meshes import BAD_MESHES
from tests.faults.inputs.bad_methods import BAD_METHODS
from tests.faults.inputs.bad_moves import BAD_MOVES
from tests.faults.inputs.bad_opens import BAD_OPENS
from tests.faults.inputs.bad_uploads import BAD_UPLOADS
from tests.faults.inputs.cases import BadInput, Names
from tests.faults.inputs.drafts import DRAFTS, Draft, Part
from tests.faults.inputs.rig import Rig, opened

#: All rows.
BAD_INPUTS: tuple[BadInput, ...] = (*BAD_OPENS, *BAD_UPLOADS, *BAD_MESHES, *BAD_METHODS, *BAD_MOVES)


@dataclass
class Verdicts:
    """What came of the rows: how many there were, and what is wrong by name."""

    seed: int
    cases: int = 0
    wrong: dict[str, str] = field(default_factory=dict)

    @property
    def right(self) -> int:
        """Rows that were answered as they have to be."""
        return self.cases - len(self.wrong)


class WrongAnswer(Exception):
    """A row was not answered as it has to be."""


def prove_bad_inputs(seed: int = 0, rows: Sequence[BadInput] = BAD_INPUTS) -> Verdicts:
    """Send every row to a session of its own kind, in this process.

    ``seed``: which node, row or axis is spoiled.
    """
    verdicts = Verdicts(seed)
    with tempfile.TemporaryDirectory() as folder:
        bench = _Bench(SessionStore(Path(folder)))
        for number, row in enumerate(rows):
            verdicts.cases += 1
            try:
                bench.run(row, np.random.default_rng((seed, number)))
            except WrongAnswer as error:
                verdicts.wrong[row.name] = str(error)
        verdicts.wrong |= bench.finish()
    return verdicts


class _Bench:
    """Sessions by their drafts and settings: those that only see bad MOVEs are shared by the rows."""

    def __init__(self, store: SessionStore) -> None:
        self._store = store
        self._numbers = iter(range(1, 1 << 32))
        self._undisturbed: dict[str, list[bytes]] = {}
        self._standing: dict[str, Rig] = {}

    def run(self, row: BadInput, rng: np.random.Generator) -> None:
        """One row."""
        good, bad = _good(row), _good(row)
        found = row.spoil(bad, rng)
        part, names = found if isinstance(found, tuple) else (None, found)
        if row.where == "open":
            self._refused_open(row, bad, names)
        elif row.where == "upload":
            assert part is not None  # the row has it
            self._refused_upload(row, good, part, names)
        elif row.where == "build":
            self._refused_build(row, good, bad, names)
        else:
            self._refused_move(row, good, bad, names)

    def finish(self) -> dict[str, str]:
        """Commit the moves of the shared sessions: their digests are those of undisturbed ones."""
        wrong = {}
        for key, rig in self._standing.items():
            committed = _bits(rig.collective("COMMIT", step=2))
            if committed != self._undisturbed[key][-len(committed) :]:
                wrong[f"the state after {key}"] = "its digest is not that of an undisturbed session"
            rig.host.close()
        return wrong

    # --- by request ------------------------------------------------------------------------------------------------

    def _refused_open(self, row: BadInput, bad: Draft, names: Names) -> None:
        reply = opened(bad, self._store, self._next())
        if isinstance(reply, Rig):
            reply.host.close()
            raise WrongAnswer("OPEN was accepted")
        _judge(reply, row, names, state="", noise=[])

    def _refused_upload(self, row: BadInput, good: Draft, part: Part, names: Names) -> None:
        rig = self._opened(good)
        _accepted([rig.upload_all(good)])
        reply = rig.upload(part)
        _judge(reply, row, names, state="OPENING", noise=rig.noise)
        _accepted(rig.collective("BUILD"))
        self._compare(row, rig.move(good))
        rig.host.close()

    def _refused_build(self, row: BadInput, good: Draft, bad: Draft, names: Names) -> None:
        rig = self._opened(bad)
        try:
            _accepted([rig.upload_all(bad)])
            replies = rig.collective("BUILD")
            for reply in replies:
                _judge(reply, row, names, state="OPENING", noise=rig.noise)
            again = rig.collective("BUILD")
            if [_words(r) for r in again] != [_words(r) for r in replies]:
                raise WrongAnswer("the same BUILD was answered in other words the second time")
            if row.mended:
                self._mend(rig, good, bad)
                _accepted(rig.collective("BUILD"))
                self._compare(row, rig.move(good))
            else:
                _accepted(rig.collective("CLOSE"))
        finally:
            rig.host.close()

    def _refused_move(self, row: BadInput, good: Draft, bad: Draft, names: Names) -> None:
        rig = self._committed(row, good)
        good.step, bad.step = 2, 2 if bad.step == 1 and row.name != "MOVE of step 1" else bad.step
        before = rig.standing()
        rig.noise.clear()
        for reply in _errors(rig.move(bad)):
            _judge(reply, row, names, state="TRIAL", noise=rig.noise)
        if rig.standing() != before:
            raise WrongAnswer("the committed state changed")
        self._compare(row, rig.move(good))

    # --- good sessions ---------------------------------------------------------------------------------------------

    def _committed(self, row: BadInput, good: Draft) -> Rig:
        """A session at step 1 with a trial of step 2, shared by the rows of this kind."""
        key = _key(row)
        if key not in self._standing:
            rig = self._ready(good)
            self._advance(rig, good)
            _accepted(rig.move(good, step=2))
            self._standing[key] = rig
            self._expected(row)
        return self._standing[key]

    def _compare(self, row: BadInput, replies: Sequence[Message]) -> None:
        """Good moves are answered as in a session that has seen nothing bad."""
        _accepted(replies)
        if _bits(replies) not in self._expected(row):
            raise WrongAnswer("a good MOVE was then answered with other bits than in an undisturbed session")

    def _expected(self, row: BadInput) -> list[list[bytes]]:
        """The answers to the first and second MOVE of an undisturbed session."""
        key = _key(row)
        if key not in self._undisturbed:
            good = _good(row)
            rig = self._ready(good)
            first = self._advance(rig, good)
            second = rig.move(good, step=2)
            _accepted(second)
            commits = rig.collective("COMMIT", step=2)
            self._undisturbed[key] = [*first, *_bits(second), *_bits(commits)]
            rig.host.close()
        known, count = self._undisturbed[key], _good(row).opening.get("partitions", 1)
        return [known[:count], known[count : 2 * count]]

    def _ready(self, good: Draft) -> Rig:
        rig = self._opened(good)
        _accepted([rig.upload_all(good)])
        _accepted(rig.collective("BUILD"))
        return rig

    def _advance(self, rig: Rig, good: Draft) -> list[bytes]:
        """MOVE and COMMIT of step 1."""
        moved = rig.move(good, step=1)
        _accepted(moved)
        _accepted(rig.collective("COMMIT", step=1))
        return _bits(moved)

    def _opened(self, draft: Draft) -> Rig:
        rig = opened(draft, self._store, self._next())
        if isinstance(rig, ErrorReply):
            raise WrongAnswer(f"OPEN was refused: {_words(rig)}")
        return rig

    def _mend(self, rig: Rig, good: Draft, bad: Draft) -> None:
        """Upload what the bad mesh lacks."""
        for partition, parts in enumerate(good.parts):
            sent = {(part.item, part.name) for part in bad.parts[partition]}
            _accepted([rig.upload(part, partition) for part in parts if (part.item, part.name) not in sent])

    def _next(self) -> str:
        return f"{next(self._numbers):032x}"


def _good(row: BadInput) -> Draft:
    """The good session of a row."""
    draft = DRAFTS[row.draft]()
    draft.set_settings(**dict(row.settings or {}))
    return draft


def _key(row: BadInput) -> str:
    return f"{row.draft} {dict(row.settings or {})}"


def _accepted(replies: Sequence[Message | None]) -> None:
    for reply in replies:
        if isinstance(reply, ErrorReply):
            raise WrongAnswer(f"a good request was refused: {_words(reply)}")


def _errors(replies: Sequence[Message]) -> list[Message]:
    """The refusals; what was answered well where nothing was refused."""
    return [reply for reply in replies if isinstance(reply, ErrorReply)] or list(replies)


def _bits(replies: Sequence[Message]) -> list[bytes]:
    """What must not change: displacements, digests."""
    return [getattr(r, "digest", b"") or getattr(r, "displacement", np.empty(0)).tobytes() for r in replies]


def _words(reply: Message) -> str:
    if not isinstance(reply, ErrorReply):
        return reply.type
    return f"{reply.code}: {reply.message} ({reply.hint}) {dict(reply.details)}"


def _judge(reply: Message, row: BadInput, names: Mapping[str, Any], *, state: str, noise: list[str]) -> None:
    """Compare an answer with the row."""
    if not isinstance(reply, ErrorReply):
        raise WrongAnswer(f"accepted: {_words(reply)}")
    wrong = []
    if reply.code != row.code:
        wrong.append(f"expected {row.code}")
    wrong += [f"expected {text!r} in the message" for text in row.says if text not in reply.message]
    wrong += [
        f"expected {key} = {value!r} in the details" for key, value in names.items() if _misses(reply, key, value)
    ]
    if reply.retryable is not row.retryable or reply.retryable is not error_code(reply.code).retryable:
        wrong.append(f"expected retryable = {row.retryable}")
    if reply.state != state:
        wrong.append(f"expected state {state!r}, got {reply.state!r}")
    if not reply.hint or "\n" in reply.message:
        wrong.append("expected one line, and a hint")
    wrong += [f"a library warned of {warning}" for warning in noise]
    if wrong:
        raise WrongAnswer(f"{'; '.join(wrong)}; got {_words(reply)}")


def _misses(reply: ErrorReply, key: str, value: Any) -> bool:
    """Whether the details do not name this."""
    if key not in reply.details:
        return True
    got = reply.details[key]
    return not value(got) if callable(value) else bool(got != value)
