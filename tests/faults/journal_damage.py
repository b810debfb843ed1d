"""Every byte of a small journal of each level is damaged, one at a time: the damage is reported or harmless, and never
gives a wrong array.

The levels "replay" and "relaxed" alternate: three rounds for every byte.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from mesh_motion_protocol.errors import DataLoss

from mesh_motion_server.session.journal.durability import ReplayKeeper
from mesh_motion_server.session.journal.journal import Journal
from mesh_motion_server.session.journal.records import PAGE
from mesh_motion_server.settings import DURABILITY_LEVELS
from tests.faults.check import Budget, Check, Result, require
from tests.faults.model_files import ModelFiles
from tests.faults.power_loss import boundary_of, entry_of, foundation_of, state_of

FOLDER = Path("/session")
STEPS = 3
#: Rounds in which every byte of a journal of the other levels has its turn.
_TURNS = 3
#: Codes that report damage.
_REPORTED = ("DATA_LOSS", "UNIMPLEMENTED.VERSION")


def small_journal(level: str = "full") -> dict[Path, bytes]:
    """The files of a journal of three steps; with "replay" the second state is stored, with "relaxed" the first state
    too.
    """
    files = ModelFiles()
    foundation = replace(foundation_of(level), record_area=PAGE, snapshot_steps=2 * (level == "replay"))
    journal = Journal.create(FOLDER, files, foundation, capacity=(STEPS + 1) * PAGE)
    if level == "relaxed":
        journal.store(entry_of(1), state_of(1))
        journal.store(entry_of(3), state_of(3), [entry_of(2)])
    elif level == "replay":
        keeper = ReplayKeeper(journal)
        for step in range(1, STEPS + 1):
            keeper.commit(entry_of(step), state_of(step), lambda step=step: boundary_of(step))  # type: ignore[misc]
    else:
        for step in range(1, STEPS + 1):
            journal.store(entry_of(step), state_of(step))
    journal.close()
    Journal.open(FOLDER, files).close()  # at rest: the last record is witnessed
    return {path: bytes(file.cache) for path, file in files.entries.items()}


def read_back(contents: dict[Path, bytes], expected: Any = (entry_of, state_of)) -> int:
    """Return the committed step that is read; −1 if the damage is reported.

    ``contents``: the journal's files; ``expected``: step → its Commit, step → its coordinates (n, d). Raises
    BrokenPromise if a wrong array or reply is read, or an error of another kind is raised.
    """
    entry, state = expected
    files = ModelFiles()
    files.restore(contents)
    try:
        journal = Journal.open(next(iter(contents)).parent, files)
        snapshot = journal.ledger.snapshot
        points: Any = journal.read_state() if snapshot else None
    except DataLoss as error:
        require(error.code.startswith(_REPORTED), f"damage is reported as {error.code}")
        return -1
    ledger = journal.ledger
    if snapshot is not None:
        require(np.array_equal(points, state(snapshot.step)), f"a wrong array is read as step {snapshot.step}")
    replies = [replace(commit, boundary=None) for commit in ledger.commits]
    require(all(commit == entry(commit.step) for commit in replies), "a wrong reply is read")
    require(all(commit.boundary == boundary_of(commit.step) for commit in ledger.logged), "a wrong input is read")
    return ledger.step


def damage(contents: dict[Path, bytes], path: Path, offset: int, bit: int) -> int:
    """Invert one bit; return the result of :func:`read_back`."""
    damaged = bytearray(contents[path])
    damaged[offset] ^= 1 << bit
    return read_back(contents | {path: bytes(damaged)})


def _damage_each(contents: dict[Path, bytes], shift: int, level: str, turns: int) -> list[int]:
    """Results of reading after damage to each byte of this round."""
    found = []
    for path, data in contents.items():
        for offset in range(shift % turns, len(data), turns):
            try:
                found.append(damage(contents, path, offset, (shift + offset) % 8))
                require(found[-1] in (-1, STEPS), f"step {found[-1]} is read of {STEPS}")
            except Exception as error:
                error.add_note(f"({level}, {path.name}, byte {offset}, bit {(shift + offset) % 8})")
                raise
    return found


def run(seed: int, budget: Budget) -> Result:
    """Each round inverts one bit of every byte, each time another bit."""
    journals = {level: small_journal(level) for level in DURABILITY_LEVELS}
    reported = harmless = rounds = 0
    while not rounds or budget.admits(rounds):
        for level, contents in journals.items():
            found = _damage_each(contents, seed + rounds, level, 1 if level == "full" else _TURNS)
            reported += found.count(-1)
            harmless += found.count(STEPS)
        rounds += 1
    size = reported + harmless
    got = f"{size} bytes in {rounds} rounds: {reported} reported, {harmless} harmless, 0 wrong"
    passed = bool(reported and harmless)
    return Result(
        got, passed, {"bytes": size, "rounds": rounds, "reported": reported, "harmless": harmless, "wrong": 0}
    )


CHECK = Check(
    "journal-damage",
    "every byte of a journal of 3 levels × {count}: never a wrong array",
    short=1,
    full=8,
    seconds=25,
    run=run,
)
