"""Power is lost between any two operations of the real journal: no promised data may vanish.

A random script uses a journal of one level of durability on the model file system: it builds, commits, flushes, raises
the epoch, fills the manifest and opens the journal again. The promise covers every acknowledged step, reply and
epoch; with "relaxed" the steps up to the durable step of a reply. Before each operation the file system is copied, and
the copies lose power; several of the possible disks are drawn, and some lose power again during the recovery. Each disk
must open, have the promised data (and an unacknowledged step completely or not at all), and take the next step.

In the second part each operation fails instead; another process reads the page cache and acknowledges its data, and
only then power is lost: data that fsync refused must not be trusted.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
from mesh_motion_protocol.digests import state_digest
from mesh_motion_protocol.errors import DataLoss
from numpy.typing import NDArray

from mesh_motion_server.session.journal import files as journal_files
from mesh_motion_server.session.journal.durability import ReplayKeeper
from mesh_motion_server.session.journal.files import KEPT_COMMITS
from mesh_motion_server.session.journal.journal import Journal
from mesh_motion_server.session.journal.ledger import BoundaryInput, Commit, Foundation
from mesh_motion_server.session.journal.records import PAGE
from mesh_motion_server.session.journal.relaxed import Backlog, RelaxedKeeper
from mesh_motion_server.session.journal.replies import RequestId
from mesh_motion_server.settings import DURABILITY_LEVELS
from tests.faults.check import Budget, Check, Result, require
from tests.faults.model_files import FailingFiles, ModelFiles, PowerLoss

FOLDER = Path("/session")
#: A state of ten sectors.
NODES, DIMENSION = 300, 2
FOUNDATION = Foundation("0" * 32, b"s" * 32, b"m" * 32, NODES, DIMENSION, 2 * PAGE)
#: Disks that are drawn for each operation.
DISKS = 6
#: Pages of a manifest, chosen for each script: full after a few records.
_PAGES = (4, 5, 6, 8)

Wrap = Callable[[Any], Any]


def _bare(files: Any) -> Any:
    return files


@cache
def state_of(step: int) -> NDArray[np.float64]:
    """The coordinates (n, d) of a step."""
    return np.random.default_rng(step).random((NODES, DIMENSION))


@cache
def entry_of(step: int) -> Commit:
    request = RequestId(b"c" * 16, step, bytes([step % 256]) * 32)
    return Commit(step, state_digest(step, state_of(step)), (request,), f"receipt {step}".encode())


@cache
def boundary_of(step: int) -> BoundaryInput:
    """The input of a step, if it is logged."""
    return BoundaryInput("committed", state_of(step)[:4].tobytes(), "the model")


def foundation_of(level: str) -> Foundation:
    """Options of a journal of this level; with "replay" every third state is stored."""
    return replace(FOUNDATION, durability=level, snapshot_steps=3 * (level == "replay"), log_bytes=1 << 20)


def random_script(random: Random) -> str:
    """A life: ``c`` commits, ``f`` flushes everything, ``e`` raises the epoch, ``o`` opens the journal again."""
    return "".join(random.choices("cfeo", (8, 3, 2, 1), k=random.randrange(4, 16)))


@dataclass
class Life:
    """One journal, and the data that it acknowledged.

    ``pages``: size of a manifest; ``step``, ``epoch``: last acknowledged ones; ``asked``: last requested step;
    ``promised_step``: with "relaxed" the last durable step of a reply.
    """

    files: Any
    pages: int = 6
    built: bool = False
    step: int = 0
    epoch: int = 0
    asked: int = 0
    level: str = "full"
    promised_step: int = 0

    def run(self, script: str) -> None:
        """Build or open the journal and check it, then run the script."""
        writer = _Writer(self._begin(), self.level)
        for command in script:
            if command == "c":
                self.asked = self.step + 1
                self.promised_step = writer.commit(self.asked)
                self.step = self.asked
            elif command == "f":
                writer.rest(self.step)
                self.promised_step = self.step
            elif command == "e":
                writer.catch_up()
                self.promised_step = self.step
                self.epoch = writer.journal.raise_epoch()
            else:
                writer.journal.close()
                writer = _Writer(self._begin(), self.level)
        writer.journal.close()

    def _begin(self) -> Journal:
        if not self.built and not self.files.exists(FOLDER / journal_files.MANIFEST):
            journal = Journal.create(FOLDER, self.files, foundation_of(self.level), capacity=self.pages * PAGE)
            self.built, self.epoch = True, 1
            return journal
        journal = Journal.open(FOLDER, self.files)
        self.built = True
        self._check(journal)
        return journal

    def _check(self, journal: Journal) -> None:
        """Check that no promised data is lost and no data is wrong, and that an unacknowledged step is complete or
        missing.
        """
        found, commits = journal.ledger.step, journal.ledger.commits
        promised = self.promised_step if self.level == "relaxed" else self.step
        require(promised <= found <= self.asked, f"step {found}; {promised} was promised, {self.asked} asked for")
        snapshot, logged = journal.ledger.snapshot, journal.ledger.logged
        stored = snapshot.step if snapshot else 0
        require(not stored or np.array_equal(journal.read_state(), state_of(stored)), f"step {stored} is a wrong array")
        require([commit.step for commit in logged] == list(range(stored + 1, found + 1)), f"a gap before step {found}")
        require(all(commit.boundary == boundary_of(commit.step) for commit in logged), f"a wrong input in {logged}")
        replies = [replace(commit, boundary=None) for commit in commits]
        require(all(commit == entry_of(commit.step) for commit in replies), f"a wrong reply in {commits}")
        kept = max(len(logged), min(found, KEPT_COMMITS))
        require(len(commits) == kept, f"{len(commits)} replies are kept at step {found}")
        self.step = self.asked = self.promised_step = found
        epoch = journal.raise_epoch()
        require(epoch > self.epoch, f"epoch {epoch} after {self.epoch} was acknowledged")
        self.epoch = epoch


class _Writer:
    """Commit as the journal's level does; with "relaxed" the work of its thread is done on call."""

    def __init__(self, journal: Journal, level: str) -> None:
        self.journal, self._level, self._backlog = journal, level, Backlog(journal)
        self._replay, self._relaxed = ReplayKeeper(journal), RelaxedKeeper(journal)

    def commit(self, step: int) -> int:
        entry, state = entry_of(step), state_of(step)
        if self._level == "replay":
            self._replay.commit(entry, state, lambda: boundary_of(step))
        elif self._level == "relaxed":
            self._backlog.accept(entry, state)
            return self._relaxed.durable_after(step)
        else:
            if step % 3:
                self.journal.write_ahead(state)
            self.journal.store(entry, state.copy() if step % 3 == 2 else state)  # not the expected one
        return step

    def catch_up(self) -> None:
        """All committed steps are durable."""
        if self._backlog:
            self._backlog.take()()

    def rest(self, step: int) -> None:
        """As before closing."""
        if self._level == "replay":
            self._replay.rest(lambda: state_of(step))
        self.catch_up()


def explore(script: str, random: Random, *, wrap: Wrap = _bare, disks: int = DISKS, level: str = "full") -> int:
    """Lose power before every operation of a script.

    ``random``: draws the disks; ``wrap``: puts a layer with a seeded bug between the journal and the model; ``disks``:
    number for each operation; ``level``: level of durability. Returns the number of tested disks. Raises BrokenPromise,
    DataLoss, OSError if acknowledged data is lost, or a disk cannot be opened; notes name the place.
    """
    raw, looked_at = ModelFiles(), 0
    life = Life(wrap(raw), random.choice(_PAGES), level=level)

    def lose_power(operation: str) -> None:
        nonlocal looked_at
        for disk in range(disks):
            try:
                looked_at += _recover(raw.copy(), life, random, wrap, interrupted=bool(disk % 2))
            except Exception as error:
                error.add_note(f"(power lost before operation {len(raw.operations)}, {operation}, disk {disk})")
                raise

    raw.before = lose_power
    life.run(script)
    return looked_at


def _recover(copy: ModelFiles, life: Life, random: Random, wrap: Wrap, *, interrupted: bool) -> int:
    """Lose power, sometimes again during the recovery, and continue; return the number of disks."""
    copy.lose_power(random)
    again = replace(life, files=wrap(copy))
    if interrupted:
        copy.arm(random.randrange(16))
        try:
            again.run("ccf")
        except PowerLoss:
            pass
        finally:
            copy.arm(None)
        copy.lose_power(random)
    again.run("cf")
    return 2 if interrupted else 1


def fail_each(script: str, random: Random, level: str = "full") -> int:
    """Let each operation fail for ever, trust the page cache, then lose power; return the number of tested disks.

    Raises BrokenPromise, DataLoss, OSError as :func:`explore`.
    """
    pages = random.choice(_PAGES)
    counted = FailingFiles(ModelFiles())
    Life(counted, pages, level=level).run(script)
    for fail_at in range(1, counted.count + 1):
        try:
            _fail_once(script, random, fail_at, Life(None, pages, level=level))
        except Exception as error:
            error.add_note(f"(operation {fail_at} failed)")
            raise
    return counted.count


def _fail_once(script: str, random: Random, fail_at: int, life: Life) -> None:
    raw = ModelFiles()
    failing = FailingFiles(raw)
    failing.fail_at = fail_at
    life.files = failing
    try:
        life.run(script)
    except (DataLoss, OSError):
        require(failing.failed, "an error without a failed operation")
    else:
        require(False, "a failed operation was not reported")
    raw.handles.clear()
    life.files = raw
    life.run("")  # another process reads what the page cache shows, and acknowledges it
    raw.handles.clear()
    raw.lose_power(random)
    life.run("ccf")


def run(seed: int, budget: Budget) -> Result:
    """Run random scripts until this number of disks was tested."""
    lost = failed = lives = 0
    while budget.admits(lost + failed):
        random = Random(f"power loss {seed} {lives}")
        script, level = random_script(random), DURABILITY_LEVELS[lives % len(DURABILITY_LEVELS)]
        try:
            lost += explore(script, random, level=level)
            failed += fail_each(script, random, level)
        except Exception as error:
            error.add_note(f"(life {lives}, level {level}, script {script})")
            raise
        lives += 1
    got = f"{lost + failed} disks of {lives} lives, 0 lost or corrupt"
    details = {"disks": lost + failed, "lives": lives, "after_failed_operations": failed}
    return Result(got, True, details | {"levels": list(DURABILITY_LEVELS)})


CHECK = Check(
    "power-loss",
    "without power, 3 levels: {count} disks, 0 lost or corrupt",
    short=50_000,
    full=1_000_000,
    seconds=40,
    run=run,
)
