"""The one calling convention of all movers."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.task import Task

__all__ = ["Mover"]


class Mover(Protocol):
    """Construction is the set-up; the caller requests each step once, in order."""

    def __init__(self, task: Task, **options: Any) -> None: ...

    def move(self, step: int) -> NDArray[np.float64]:
        """Positions (n, d) of all nodes after a step, counted from 0."""
        ...
