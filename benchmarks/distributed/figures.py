"""What a run of the benchmark finds, and its file."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path

__all__ = ["Results", "Row"]


@dataclass(frozen=True)
class Row:
    """One step of one mesh on some workers.

    Attributes
    ----------
    case : str
    way : {"one machine", "session", "partitions"}
        Without workers; with displacements back (a session); with summaries back only.
    nodes, boundary, workers : int
    halo : float
        Halo nodes of all partitions, as a share of all nodes.
    wall, here, longest, all_workers : float, seconds
        Wall time; processor time of this process (which is the scheduler too), of the busiest worker, of all.
    solve, pack : float, seconds
        Of ``here``: the interpolation, and cutting the coefficients up for the partitions.
    sent, received : dict of str to int
        Bytes by kind.
    rounds : int
    setup : float, seconds
        Wall time from nothing to the first summary.
    difference : float
        Largest distance of a node from where one machine puts it, mesh length unit.
    """

    case: str
    way: str
    nodes: int
    boundary: int
    workers: int
    halo: float
    wall: float
    here: float
    longest: float
    all_workers: float
    solve: float
    pack: float
    sent: dict[str, int]
    received: dict[str, int]
    rounds: int
    setup: float
    difference: float


@dataclass
class Results:
    """All rows, and what a message costs.

    Attributes
    ----------
    rows : list of Row
    round_trip, per_task : float, seconds
        Wall time of an empty question: of one, and for each partition more.
    bandwidth : float, bytes a second
        From workers to this process, over the loopback.
    machine : str
    """

    machine: str
    round_trip: float = 0.0
    per_task: float = 0.0
    bandwidth: float = 0.0
    rows: list[Row] = field(default_factory=list)

    def save(self, path: Path) -> None:
        """As JSON."""
        path.write_text(json.dumps(asdict(self), indent=1), encoding="utf-8")

    @classmethod
    def load(cls, path: Path) -> Results:
        """The inverse of :meth:`save`."""
        values = json.loads(path.read_text(encoding="utf-8"))
        return cls(**values | {"rows": [Row(**row) for row in values["rows"]]})

    def of(self, case: str, way: str, workers: int) -> Row | None:
        """One row."""
        found = (row for row in self.rows if (row.case, row.way, row.workers) == (case, way, workers))
        return next(found, None)
