"""Counts of one process, small enough to be sent with the reports of a worker.

Each process has one :data:`TALLY`. Workers and the gateway send theirs as differences (:meth:`Tally.take`), which the
supervisor adds to its own. So a total never decreases, and the end of a worker loses only counts that it had not sent.
A session that stores its commits after the answers counts from two threads; therefore there is a lock.
"""

from __future__ import annotations

import threading
import time
from bisect import bisect_left
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from mesh_motion_server.operation.metrics import METRICS


class Tally:
    """Counters by name and label, and histograms by name.

    Attributes
    ----------
    counts : dict
        (name, label) → sum.
    spreads : dict
        Name → number of observations per bucket, the last one beyond all bounds, followed by their sum.
    """

    def __init__(self) -> None:
        self.counts: dict[tuple[str, str], float] = {}
        self.spreads: dict[str, list[float]] = {}
        self._lock = threading.RLock()

    def __bool__(self) -> bool:
        """Whether anything was counted."""
        return bool(self.counts or self.spreads)

    def count(self, name: str, amount: float = 1, *, label: str = "") -> None:
        """Add to a counter."""
        key = (name, label)
        with self._lock:
            self.counts[key] = self.counts.get(key, 0) + amount

    def observe(self, name: str, value: float) -> None:
        """Add an observation to a histogram."""
        bounds = METRICS[name].bounds
        with self._lock:
            spread = self.spreads.setdefault(name, [0.0] * (len(bounds) + 2))
            spread[bisect_left(bounds, value)] += 1
            spread[-1] += value

    @contextmanager
    def timed(self, name: str) -> Iterator[None]:
        """Observe the duration of the block, in seconds, also if it raises."""
        started = time.perf_counter()
        try:
            yield
        finally:
            self.observe(name, time.perf_counter() - started)

    def values(self) -> dict[str, Any]:
        """Return all counts as plain values."""
        return {"counts": [[*key, value] for key, value in self.counts.items()], "spreads": self.spreads}

    def take(self) -> dict[str, Any]:
        """Return all counts since the last call as plain values, and reset them."""
        with self._lock:
            taken = self.values()
            self.counts, self.spreads = {}, {}
        return taken

    def add(self, taken: dict[str, Any] | None) -> None:
        """Add the counts that another process has taken."""
        if taken is None:
            return
        for name, label, value in taken["counts"]:
            self.count(name, value, label=label)
        for name, spread in taken["spreads"].items():
            mine = self.spreads.get(name, [0.0] * len(spread))
            self.spreads[name] = [a + b for a, b in zip(mine, spread, strict=True)]


#: The counts of this process.
TALLY = Tally()
