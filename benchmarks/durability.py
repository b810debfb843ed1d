"""The cost of a commit at each level of durability: ``python -m benchmarks.durability [--folder DIR] [--commits N]``.

The journal's own code commits states of 1, 10 and 100 MB (n nodes in 3D, of which n^(2/3) move). The levels alternate,
so that changes of the disk's speed affect all levels alike. For comparison the disk alone is measured: a page
overwritten and synced, and the state overwritten and synced. "relaxed" is measured twice: with commits as fast as the
disk takes them (time of the answer) and with one commit every 5 ms (lag of the durable step). Values are medians;
"replay" is also given with its share of a state that is stored every ``snapshot_steps`` commits.
"""

from __future__ import annotations

import argparse
import os
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from mesh_motion_server.session.journal.durability import keeper_of, log_bytes
from mesh_motion_server.session.journal.files import KEPT_COMMITS
from mesh_motion_server.session.journal.filesystem import PosixFileSystem
from mesh_motion_server.session.journal.journal import Journal, record_area
from mesh_motion_server.session.journal.keeper import Keeper
from mesh_motion_server.session.journal.ledger import BoundaryInput, Commit, Foundation
from mesh_motion_server.session.journal.replies import RequestId
from mesh_motion_server.settings import DURABILITY_LEVELS, ServerSettings

__all__ = ["main", "measure"]

MEGABYTES = (1, 10, 100)
_DIMENSION = 3


def moving_nodes(nodes: int) -> int:
    """Displacements of a body in a domain with ``nodes`` nodes."""
    return int(nodes ** (2 / 3))


def _keeper(folder: Path, level: str, nodes: int) -> Keeper:
    """A new journal of one level."""
    folder.mkdir()
    replay = level == "replay"
    foundation = Foundation(
        "0" * 32, bytes(32), bytes(32), nodes, _DIMENSION, record_area(1, KEPT_COMMITS if level == "relaxed" else 1),
        level, ServerSettings().snapshot_steps if replay else 0, log_bytes(8 * nodes * _DIMENSION) if replay else 0,
    )  # fmt: skip
    return keeper_of(Journal.create(folder, PosixFileSystem(), foundation))


def _seconds(work: Callable[[], object]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


class _Disk:
    """A file of the state's size, overwritten and synced."""

    def __init__(self, path: Path, size: int) -> None:
        self._handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o600)
        os.posix_fallocate(self._handle, 0, size)

    def write(self, data: Any) -> None:
        """Overwrite the beginning, sync."""
        os.pwrite(self._handle, data, 0)
        os.fdatasync(self._handle)

    def close(self) -> None:
        os.close(self._handle)


def measure(folder: Path, megabytes: int, commits: int) -> dict[str, float]:
    """Median seconds of each operation."""
    nodes = round(megabytes * 1e6 / (8 * _DIMENSION))
    states = [np.random.default_rng(seed).random((nodes, _DIMENSION)) for seed in (1, 2)]
    rows = np.random.default_rng(3).random((moving_nodes(nodes), _DIMENSION)).tobytes()
    keepers = {level: _keeper(folder / f"{level}-{megabytes}", level, nodes) for level in DURABILITY_LEVELS}
    disk, found = _Disk(folder / f"disk-{megabytes}", 8 * states[0].size), dict[str, list[float]]()
    for step in range(1, commits + 1):
        state = states[step % 2]
        entry = Commit(step, bytes(32), (RequestId(bytes(16), step, bytes(32)),), bytes(2000))
        for level, keeper in keepers.items():
            work = _commit(keeper, entry, state, rows)
            found.setdefault(level, []).append(_seconds(work))
            found.setdefault(f"{level}, all durable", []).append(found[level][-1] + _seconds(keeper.catch_up))
        found.setdefault("page", []).append(_seconds(lambda: disk.write(bytes(4096))))
        found.setdefault("state", []).append(_seconds(lambda state=state: disk.write(state.data)))  # type: ignore[misc]
    disk.close()
    lag = _lag(keepers["relaxed"], states, rows, commits)
    for keeper in keepers.values():
        keeper.close()
    medians = {name: statistics.median(seconds) for name, seconds in found.items()}
    share = (medians["full"] - medians["replay"]) / ServerSettings().snapshot_steps
    return medians | {"replay, in all": medians["replay"] + share, "lag": float(lag)}


def _commit(keeper: Keeper, entry: Commit, state: Any, rows: bytes) -> Callable[[], None]:
    return lambda: keeper.commit(entry, state, lambda: BoundaryInput("committed", rows, "the benchmark"))


def _lag(keeper: Keeper, states: list[Any], rows: bytes, commits: int) -> int:
    """Largest lag of the durable step, in steps, with one commit every 5 ms."""
    first, behind = keeper.durable_step + 1, 0
    for step in range(first, first + 4 * commits):
        _commit(keeper, Commit(step, bytes(32), (), b""), states[step % 2], rows)()
        behind = max(behind, step - keeper.durable_step)
        time.sleep(0.005)
    keeper.catch_up()
    return behind


def main(arguments: list[str]) -> None:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--folder", help="folder on the disk to measure")
    parser.add_argument("--commits", type=int, default=50)
    given = parser.parse_args(arguments)
    say = sys.stdout.write
    say(
        "| state | page synced | state synced | full | replay: logged, in all | relaxed: answered, durable | behind |\n"
    )
    say("|---|---|---|---|---|---|---|\n")
    for megabytes in MEGABYTES:
        with tempfile.TemporaryDirectory(dir=given.folder, prefix="durability-") as folder:
            m = measure(Path(folder), megabytes, given.commits if megabytes < 100 else max(4, given.commits // 4))
        full = m["full"]

        def cell(name: str, m: dict[str, float] = m, full: float = full) -> str:
            return f"{1000 * m[name]:.3g} ms ({m[name] / full:.2g})"

        say(
            f"| {megabytes} MB | {cell('page')} | {cell('state')} | {cell('full')} | {cell('replay')}, "
            f"{cell('replay, in all')} | {cell('relaxed')}, {cell('relaxed, all durable')} | {m['lag']:.0f} steps |\n"
        )


if __name__ == "__main__":
    main(sys.argv[1:])
