"""Arrays that came in several pieces."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["joined"]


def joined(pieces: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Concatenate the pieces (k, …) by rows; a single piece is returned without a copy."""
    return pieces[0] if len(pieces) == 1 else np.concatenate(pieces)
