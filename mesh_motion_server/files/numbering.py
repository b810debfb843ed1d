"""Rows of the numbered items of a file: numbers may be sparse and in any order."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from mesh_motion_numerics.arrays import Integers


@dataclass(frozen=True, eq=False)
class NumberedRows:
    """The row of each number; ``missing`` makes the error for a number that does not exist."""

    numbers: Integers  # (n,) ascending
    rows: Integers  # (n,)
    missing: str = "{what} {number} is named, but does not exist"

    @classmethod
    def of(cls, numbers: Integers, **more: str) -> NumberedRows:
        """Build the table from the numbers (n,) of all nodes. Raises ValueError if a number occurs twice."""
        order = np.argsort(numbers, kind="stable")
        ascending = numbers[order]
        if len(twice := ascending[1:][np.diff(ascending) == 0]):
            raise ValueError(f"node {int(twice[0])} appears twice")
        return cls(ascending, order, **more)

    def __call__(self, named: Integers, what: str = "node") -> Integers:
        """Return the rows of the numbers ``named``, in their shape. Raises ValueError if a number does not exist."""
        places = np.searchsorted(self.numbers, named)
        known = places < len(self.numbers)
        known[known] = self.numbers[places[known]] == named[known]
        if not known.all():
            raise ValueError(self.missing.format(what=what, number=int(named[~known][0])))
        return self.rows[places]
