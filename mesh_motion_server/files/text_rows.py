"""Numbers as lines of text, so that reading them gives the same bits."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["integer_rows", "real_rows"]


def integer_rows(rows: NDArray[np.integer], before: Sequence[object] = ()) -> Iterable[str]:
    """One line for each row (m, k), with the same words before each."""
    head = "".join(f"{word} " for word in before)
    return (head + " ".join(map(str, row)) for row in rows.tolist())


def real_rows(rows: NDArray[np.floating]) -> Iterable[str]:
    """One line for each row (m, k), with as many digits as it takes."""
    return (" ".join(map(repr, row)) for row in rows.astype(np.float64).tolist())
