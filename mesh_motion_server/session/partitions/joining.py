"""Arrays that came in several pieces."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["joined"]


def joined(pieces: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """The pieces (k, …) one below the other; an only piece itself, uncopied."""
    return pieces[0] if len(pieces) == 1 else np.concatenate(pieces)
