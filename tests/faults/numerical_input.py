"""Bad inputs for a session, each answered with the right typed error and without any effect, and extreme inputs, each
accepted.

A bad case changes a good session's requests in one place. What is judged:

- the refused request, and no other, is answered by ERROR with the case's code, ``retryable`` and the state before; the
  message and the details name the first offender, the hint the way out; no library gave a warning as well;
- the session is as before: a good request gives, bitwise, what it gives in a session that never saw the bad one, and
  so does the digest of the committed state. After a bad mesh, which cannot be removed, the same BUILD is refused with
  the same text, and CLOSE is answered.

After an extreme input the moving nodes are bitwise at their prescribed positions, no library warns, the step can be
committed, and the answer is as exact as its row says. The rows are in :mod:`tests.faults.inputs`.
"""

import tempfile
from collections.abc import Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from mesh_motion_protocol.errors import error_code
from mesh_motion_protocol.messages import Built, ErrorReply, Message, Moved

from tests.faults.check import BrokenPromise, Budget, Check, Result, require
from tests.faults.in_process import InProcessServer, allow_everybody_listed, quiet
from tests.faults.inputs.bad_meshes import BAD_MESHES
from tests.faults.inputs.bad_methods import BAD_METHODS
from tests.faults.inputs.bad_moves import BAD_MOVES
from tests.faults.inputs.bad_uploads import BAD_UPLOADS
from tests.faults.inputs.cases import BadInput, Names
from tests.faults.inputs.drafts import DRAFTS, Draft, Part
from tests.faults.inputs.extremes import EXTREMES, Extreme, Outcome
from tests.faults.inputs.rig import LIMITS, Rig, opened

#: All rows of bad inputs.
BAD_INPUTS: tuple[BadInput, ...] = (*BAD_UPLOADS, *BAD_MESHES, *BAD_METHODS, *BAD_MOVES)


@dataclass
class Verdicts:
    """Results of the rows: their number, and the failed ones by name."""

    seed: int = 0
    cases: int = 0
    wrong: dict[str, str] = field(default_factory=dict)

    @contextmanager
    def of(self, name: str) -> Any:
        """Run one row; its exception says what is wrong."""
        self.cases += 1
        try:
            yield
        except BrokenPromise as error:
            self.wrong[name] = str(error)

    @property
    def right(self) -> int:
        return self.cases - len(self.wrong)


@contextmanager
def _bench() -> Any:
    with tempfile.TemporaryDirectory() as folder, quiet():
        yield _Bench(InProcessServer(allow_everybody_listed(Path(folder)), None, LIMITS))


def prove_bad_inputs(seed: int = 0, rows: Sequence[BadInput] = BAD_INPUTS) -> Verdicts:
    """Send every row to a session of its kind; ``seed`` chooses the changed node, row or axis."""
    verdicts = Verdicts(seed)
    with _bench() as bench:
        for number, row in enumerate(rows):
            with verdicts.of(row.name):
                bench.run(row, np.random.default_rng((seed, number)))
        verdicts.wrong |= bench.finish()
    return verdicts


def prove_extreme_inputs(rows: Sequence[Extreme] = EXTREMES) -> Verdicts:
    """Run a session for each row, without random choices."""
    verdicts = Verdicts()
    with _bench() as bench:
        known = {name: bench.outcome(DRAFTS[name]()) for name in {row.draft for row in rows}}
        for row in rows:
            with verdicts.of(row.name):
                row.change(draft := DRAFTS[row.draft]())
                complaint = row.judge(bench.outcome(draft), known[row.draft])
                require(not complaint, complaint)
    return verdicts


class _Bench:
    """Sessions by their drafts and settings: rows with bad MOVEs only share them."""

    def __init__(self, server: InProcessServer) -> None:
        self._server, self._numbers = server, count(1)
        self._undisturbed: dict[str, list[bytes]] = {}
        self._standing: dict[str, Rig] = {}

    def run(self, row: BadInput, rng: np.random.Generator) -> None:
        good, bad = _good(row), _good(row)
        found = row.spoil(bad, rng)
        part, names = found if isinstance(found, tuple) else (None, found)
        if row.where == "upload":
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
        return wrong

    def outcome(self, draft: Draft) -> Outcome:
        """Answers of a session of one partition to a valid, extreme input."""
        rig = self._opened(draft)
        _accepted([rig.upload_all(draft)])
        (built,), (moved,) = rig.collective("BUILD"), rig.move(draft)
        _accepted([built, moved, *rig.collective("COMMIT", step=1)])
        rig.end()
        require(not rig.noise, f"a library warned of {rig.noise[:1]}")
        assert isinstance(built, Built)  # errors are raised above
        assert isinstance(moved, Moved)
        prescribed, reached = draft.moved.astype(np.float64), moved.displacement[built.moving_nodes]
        require(reached.tobytes() == prescribed.tobytes(), "a moving node is not at its prescribed position")
        summary = moved.quality["corrected"]
        return Outcome(moved.displacement, prescribed, built.moving_nodes, summary, list(built.mesh["warnings"]))

    # --- bad inputs by request -------------------------------------------------------------------------------------

    def _refused_upload(self, row: BadInput, good: Draft, part: Part, names: Names) -> None:
        rig = self._opened(good)
        _accepted([rig.upload_all(good)])
        _judge(rig.upload(part), row, names, state="OPENING", noise=rig.noise)
        _accepted(rig.collective("BUILD"))
        self._compare(row, rig.move(good))
        rig.end()

    def _refused_build(self, row: BadInput, good: Draft, bad: Draft, names: Names) -> None:
        rig = self._opened(bad)
        _accepted([rig.upload_all(bad)])
        replies = rig.collective("BUILD")
        for reply in replies:
            _judge(reply, row, names, state="OPENING", noise=rig.noise)
        again = rig.collective("BUILD")
        require([_words(r) for r in again] == [_words(r) for r in replies], "the same BUILD was answered otherwise")
        if row.mended:
            for partition, parts in enumerate(good.parts):
                sent = {(part.item, part.name) for part in bad.parts[partition]}
                _accepted([rig.upload(part, partition) for part in parts if (part.item, part.name) not in sent])
            _accepted(rig.collective("BUILD"))
            self._compare(row, rig.move(good))
            rig.end()
        else:
            _accepted(rig.collective("CLOSE"))

    def _refused_move(self, row: BadInput, good: Draft, bad: Draft, names: Names) -> None:
        rig = self._committed(row, good)
        good.step, bad.step = 2, 2 if bad.step == 1 and row.name != "MOVE of step 1" else bad.step
        before = rig.standing()
        rig.noise.clear()
        replies = rig.move(bad)
        for reply in [reply for reply in replies if isinstance(reply, ErrorReply)] or replies:
            _judge(reply, row, names, state="TRIAL", noise=rig.noise)
        require(rig.standing() == before, "the committed state changed")
        self._compare(row, rig.move(good))

    # --- good sessions ---------------------------------------------------------------------------------------------

    def _committed(self, row: BadInput, good: Draft) -> Rig:
        """A session at step 1 with a trial of step 2, shared by the rows of this kind."""
        key = _key(row)
        if key not in self._standing:
            self._standing[key], _ = self._advanced(good)
            _accepted(self._standing[key].move(good, step=2))
            self._expected(row)
        return self._standing[key]

    def _compare(self, row: BadInput, replies: Sequence[Message]) -> None:
        """Check that good moves are answered as in a session without bad inputs."""
        _accepted(replies)
        same = _bits(replies) in self._expected(row)
        require(same, "a good MOVE was then answered with other bits than in an undisturbed session")

    def _expected(self, row: BadInput) -> list[list[bytes]]:
        """The answers to the first and second MOVE of an undisturbed session."""
        key, good = _key(row), _good(row)
        if key not in self._undisturbed:
            rig, first = self._advanced(good)
            second = rig.move(good, step=2)
            _accepted(second)
            self._undisturbed[key] = [*first, *_bits(second), *_bits(rig.collective("COMMIT", step=2))]
            rig.end()
        known, partitions = self._undisturbed[key], good.opening.get("partitions", 1)
        return [known[:partitions], known[partitions : 2 * partitions]]

    def _advanced(self, good: Draft) -> tuple[Rig, list[bytes]]:
        """A session after MOVE and COMMIT of step 1, and the reply to that MOVE."""
        rig = self._opened(good)
        _accepted([rig.upload_all(good)])
        _accepted(rig.collective("BUILD"))
        moved = rig.move(good, step=1)
        _accepted([*moved, *rig.collective("COMMIT", step=1)])
        return rig, _bits(moved)

    def _opened(self, draft: Draft) -> Rig:
        rig = opened(draft, self._server, next(self._numbers))
        if isinstance(rig, ErrorReply):
            raise BrokenPromise(f"OPEN was refused: {_words(rig)}")
        return rig


def _good(row: BadInput) -> Draft:
    draft = DRAFTS[row.draft]()
    draft.set_settings(**dict(row.settings or {}))
    return draft


def _key(row: BadInput) -> str:
    return f"{row.draft} {dict(row.settings or {})}"


def _accepted(replies: Sequence[Message | None]) -> None:
    for reply in replies:
        require(not isinstance(reply, ErrorReply), f"a good request was refused: {_words(reply)}")


def _bits(replies: Sequence[Message]) -> list[bytes]:
    """The values that must not change: displacements, digests."""
    return [getattr(r, "digest", b"") or getattr(r, "displacement", np.empty(0)).tobytes() for r in replies]


def _words(reply: Any) -> str:
    if not isinstance(reply, ErrorReply):
        return getattr(reply, "type", "accepted")
    return f"{reply.code}: {reply.message} ({reply.hint}) {dict(reply.details)}"


def _judge(reply: Any, row: BadInput, names: Mapping[str, Any], *, state: str, noise: list[str]) -> None:
    if not isinstance(reply, ErrorReply):
        raise BrokenPromise(f"accepted: {_words(reply)}")
    wrong = [] if reply.code == row.code else [f"expected {row.code}"]
    wrong += [f"expected {text!r} in the message" for text in row.says if text not in reply.message]
    wrong += [f"expected {key} = {value!r} in the details" for key, value in names.items()
              if key not in reply.details or _differs(reply.details[key], value)]  # fmt: skip
    if reply.retryable or error_code(reply.code).retryable:
        wrong.append("expected no retryable error")
    if reply.state != state:
        wrong.append(f"expected state {state!r}, got {reply.state!r}")
    if not reply.hint or "\n" in reply.message:
        wrong.append("expected one line, and a hint")
    wrong += [f"a library warned of {warning}" for warning in noise]
    require(not wrong, f"{'; '.join(wrong)}; got {_words(reply)}")


def _differs(got: Any, value: Any) -> bool:
    return not value(got) if callable(value) else bool(got != value)


def run(seed: int, budget: Budget) -> Result:
    """Run the whole table of bad inputs, each round with other changed places, then the extreme inputs."""
    right = rounds = 0
    while not rounds or budget.admits(right):
        right += _require_none_wrong(prove_bad_inputs(seed + rounds))
        rounds += 1
    extreme = _require_none_wrong(prove_extreme_inputs())
    got = f"{right} of {right}; {extreme} of {extreme} extreme ones exact"
    return Result(got, passed=True, details={"refused": right, "rounds": rounds, "extreme": extreme})


def _require_none_wrong(verdicts: Verdicts) -> int:
    for name, why in verdicts.wrong.items():
        wrong = f"{len(verdicts.wrong)} of {verdicts.cases} wrong with seed {verdicts.seed}"
        raise BrokenPromise(f"{wrong}: {name}: {why}")
    return verdicts.cases


CHECK = Check(
    name="numbers",
    target="{count} bad inputs: due error, offender named, no trace",
    short=len(BAD_INPUTS),
    full=20 * len(BAD_INPUTS),
    seconds=12.0,
    run=run,
)
