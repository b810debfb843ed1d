"""Arrays as the compiled kernels take them.

A kernel is compiled once for every combination of writable and read-only arguments that it meets, seconds each. Inputs
therefore always arrive read-only: a session's frozen arrays and a caller's own share one compiled kernel.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["read_only"]


def read_only(array: NDArray[Any]) -> NDArray[Any]:
    """A contiguous view that cannot be written; a copy only if the array is not contiguous."""
    view = np.ascontiguousarray(array).view()
    view.flags.writeable = False
    return view
