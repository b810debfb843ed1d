"""What runs on a worker: a partition with positions by version, and its tasks.

The session that holds the partition numbers the versions; 0 is the reference mesh, which always exists. If this worker
does not have the version that a task needs (the partition was rebuilt, or Dask moved it), the task gives no answer, and
is repeated with the positions themselves.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.distributed.counted_cells import CountedCells
from mesh_motion_server.distributed.order_statistics import BinContent
from mesh_motion_server.distributed.packing import unpack
from mesh_motion_server.distributed.split import MeshPartition
from mesh_motion_server.distributed.summaries import PartialSummary, Questions
from mesh_motion_server.numerics.interpolation.evaluation import LocalEvaluator
from mesh_motion_server.numerics.mesh.points import bounding_box
from mesh_motion_server.numerics.quality.metrics import CellsAtRest, cells_at_rest

__all__ = [
    "Answer",
    "HeldPartition",
    "Positions",
    "VersionLost",
    "displace",
    "gradient",
    "judge",
    "perform",
    "questioned",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class VersionLost(Exception):
    """The worker does not have the requested version of the positions."""


@dataclass(frozen=True, eq=False)
class Positions:
    """Positions of a partition's nodes: a version that the worker has, except for some rows.

    Attributes
    ----------
    version : int or None
        None: the values are the positions of all rows.
    rows : (k,) int64 array or None
    values : (k, d) array, mesh length unit
    """

    version: int | None
    rows: Ints | None = None
    values: Floats | None = None


@dataclass(eq=False)
class HeldPartition:
    """A partition on a worker.

    Attributes
    ----------
    mesh : MeshPartition
    versions : dict of int to (p, d) array
        Positions; only the versions that the last question asked to keep.
    judged : CountedCells or None
        The cells as they were judged last, for questions about them.
    """

    mesh: MeshPartition
    versions: dict[int, Floats] = field(default_factory=dict)
    judged: CountedCells | None = None

    def __getstate__(self) -> dict[str, Any]:
        """Send only the mesh; versions stay on the worker."""
        return {"mesh": self.mesh, "versions": {}, "judged": None}

    def __sizeof__(self) -> int:
        """Return the bytes with three versions; Dask uses them to place and spill data."""
        return self.mesh.nbytes + 3 * self.mesh.points.nbytes

    @cached_property
    def at_rest(self) -> CellsAtRest:
        """Return the cells of the reference mesh."""
        return cells_at_rest(self.mesh.points, self.mesh.cells, self.mesh.reference_sizes)

    def at(self, where: Positions) -> Floats:
        """(p, d) positions.

        Raises
        ------
        VersionLost
            If this worker does not have the version.
        """
        if where.version is None:
            return _given(where.values)
        found = self.mesh.points if where.version == 0 else self.versions.get(where.version)
        if found is None:
            raise VersionLost(f"version {where.version}")
        if where.rows is None or not len(where.rows):
            return found
        found = found.copy()
        found[where.rows] = _given(where.values)
        return found

    def store(self, version: int, positions: Floats, keep: tuple[int, ...]) -> None:
        """Keep a version, and of the others only those in ``keep``."""
        self.versions = {number: old for number, old in self.versions.items() if number in keep}
        self.versions[version] = positions


def _given(values: Floats | None) -> Floats:
    """Return values received from the session, which must be present."""
    if values is None:
        raise VersionLost("no values")
    return values


@dataclass(frozen=True, eq=False)
class Answer:
    """The answer of a task on a worker.

    Attributes
    ----------
    value : object or None
        None if a version is lost.
    seconds : float
        Processor time it took.
    """

    value: Any
    seconds: float


def perform(held: HeldPartition, task: Callable[..., Any], *arguments: Any) -> Answer:
    """Run one of the tasks below."""
    begin = time.thread_time()
    try:
        value = task(held, *arguments)
    except VersionLost:
        value = None
    return Answer(value, time.thread_time() - begin)


def displace(
    held: HeldPartition, where: Positions, start: int, packed: bytes, moved: int, keep: tuple[int, ...]
) -> tuple[Floats, Floats]:
    """Displace the nodes; keep the old positions as version ``start`` and the new ones as ``moved``.

    Returns
    -------
    (o, d) displacement of its own nodes and (2, d) box of the new positions, mesh length unit.
    """
    points = held.at(where)
    found = LocalEvaluator().displacement(unpack(packed)[0], points)
    positions = points + found
    held.store(start, points, keep)
    held.store(moved, positions, (*keep, start))
    return found[held.mesh.own], bounding_box(positions)


def gradient(held: HeldPartition, where: Positions, packed: bytes) -> Floats:
    """(o, k, d) gradients of an interpolant at its own nodes."""
    points = held.at(where)[held.mesh.own]
    return LocalEvaluator().gradient(unpack(packed)[0], points)


def judge(
    held: HeldPartition, where: Positions, version: int, metric: str, keep: tuple[int, ...]
) -> tuple[PartialSummary, Floats]:
    """Judge its cells at positions and keep these as a version; return the quality and their (2, d) box."""
    points = held.at(where)
    held.store(version, points, keep)
    if held.judged is None or held.judged.metric != metric:
        held.judged = CountedCells(held.mesh.cells, held.at_rest, metric)
    return held.judged.judge(points, held.mesh.cell_numbers), bounding_box(points)


def questioned(
    held: HeldPartition,
    questions: Questions,
    where: Positions | None,
    version: int,
    metric: str,
    keep: tuple[int, ...],
) -> tuple[BinContent, ...]:
    """Return the contents of bins from the qualities judged last, or at given positions, judged first.

    Raises
    ------
    VersionLost
        If there are no qualities and no positions are given.
    """
    if where is not None:
        judge(held, where, version, metric, keep)
    if held.judged is None:
        raise VersionLost("no quality")
    return held.judged.contents(questions)
