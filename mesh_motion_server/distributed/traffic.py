"""Bytes sent and received, by purpose."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import numpy as np

__all__ = ["Traffic", "size_of"]


@dataclass(eq=False)
class Traffic:
    """Payload to and from the workers, without the frames of Dask and TCP, which add a few percent.

    Attributes
    ----------
    sent, received : Counter
        Bytes by kind. Sent: ``mesh`` (partitions, at opening or after a loss), ``coefficients``, ``positions`` (those
        that workers cannot compute: boundary nodes and what a correction moved), ``questions``. Received:
        ``displacements``, ``summaries``.
    rounds : int
        Questions to all workers, each at least a round trip.
    rebuilt : int
        Partitions that had to be placed again.
    """

    sent: Counter[str] = field(default_factory=Counter)
    received: Counter[str] = field(default_factory=Counter)
    rounds: int = 0
    rebuilt: int = 0

    def copy(self) -> Traffic:
        """Return the current values."""
        return Traffic(Counter(self.sent), Counter(self.received), self.rounds, self.rebuilt)

    def since(self, before: Traffic) -> Traffic:
        """Return what was added since a copy."""
        return Traffic(
            self.sent - before.sent,
            self.received - before.received,
            self.rounds - before.rounds,
            self.rebuilt - before.rebuilt,
        )


def size_of(value: Any) -> int:
    """Bytes of arrays and strings in a value, through tuples, lists, dicts and dataclasses; 8 for a number."""
    if isinstance(value, np.ndarray):
        return int(value.nbytes)
    if isinstance(value, (bytes, str)):
        return len(value)
    if isinstance(value, dict):
        return sum(size_of(key) + size_of(entry) for key, entry in value.items())
    if isinstance(value, (tuple, list)):
        return sum(map(size_of, value))
    if hasattr(value, "__dataclass_fields__"):
        return sum(size_of(getattr(value, name)) for name in value.__dataclass_fields__)
    return 0 if value is None else 8
