"""Every byte of a small journal is damaged, one at a time: the damage is told or harmless, never a wrong array."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from mesh_motion_server.errors import JournalError
from mesh_motion_server.prove.check import Budget, Check, Result, require
from mesh_motion_server.prove.model_files import ModelFiles
from mesh_motion_server.prove.power_loss import entry_of, state_of
from mesh_motion_server.session.journal import Journal
from mesh_motion_server.session.ledger import Foundation
from mesh_motion_server.session.records import PAGE

__all__ = ["CHECK", "damage", "read_back", "small_journal"]

FOLDER = Path("/session")
STEPS = 3
#: Codes that tell of damage.
_TOLD = ("DATA_LOSS", "UNIMPLEMENTED.VERSION")


def small_journal() -> dict[Path, bytes]:
    """The files of a journal of three steps."""
    files = ModelFiles()
    nodes, dimension = state_of(1).shape
    foundation = Foundation("0" * 32, b"s" * 32, b"m" * 32, nodes, dimension, PAGE)
    journal = Journal.create(FOLDER, files, foundation, capacity=(STEPS + 1) * PAGE)
    for step in range(1, STEPS + 1):
        journal.commit(entry_of(step), state_of(step))
    journal.close()
    return {path: bytes(file.cache) for path, file in files.entries.items()}


def read_back(contents: dict[Path, bytes], expected: Any = (entry_of, state_of)) -> int:
    """The committed step that is read; −1 if the damage is told.

    Parameters
    ----------
    contents : dict
        The journal's files.
    expected : pair of callables
        Step → its Commit, step → its coordinates (n, d).

    Raises
    ------
    BrokenPromise
        If a wrong array or reply is read, or an error of another kind is raised.
    """
    entry, state = expected
    files = ModelFiles()
    files.restore(contents)
    try:
        journal = Journal.open(next(iter(contents)).parent, files)
    except JournalError as error:
        require(error.code.startswith(_TOLD), f"damage is told as {error.code}")
        return -1
    step = journal.ledger.step
    require(not step or np.array_equal(journal.read_state(), state(step)), f"a wrong array is read as step {step}")
    require(all(commit == entry(commit.step) for commit in journal.ledger.commits), "a wrong reply is read")
    return step


def damage(contents: dict[Path, bytes], path: Path, offset: int, bit: int) -> int:
    """Turn one bit; what :func:`read_back` then finds."""
    damaged = bytearray(contents[path])
    damaged[offset] ^= 1 << bit
    return read_back(contents | {path: bytes(damaged)})


def run(seed: int, budget: Budget) -> Result:
    """One bit of every byte in each round, another one in the next."""
    contents = small_journal()
    told = harmless = rounds = 0
    while not rounds or budget.admits(rounds):
        for path, data in contents.items():
            for offset in range(len(data)):
                try:
                    step = damage(contents, path, offset, (seed + rounds + offset) % 8)
                    require(step in (-1, STEPS), f"step {step} is read of {STEPS}")
                except Exception as error:
                    error.add_note(f"({path.name}, byte {offset}, round {rounds})")
                    raise
                told += step == -1
                harmless += step == STEPS
        rounds += 1
    size = sum(map(len, contents.values()))
    got = f"{size} bytes × {rounds}: {told} told, {harmless} harmless, 0 wrong"
    passed = bool(told and harmless)
    return Result(got, passed, {"bytes": size, "rounds": rounds, "told": told, "harmless": harmless, "wrong": 0})


CHECK = Check(
    "journal-damage",
    "every byte of a journal damaged × {count}: never a wrong array",
    short=1,
    full=8,
    seconds=15,
    run=run,
)
