"""The types of arrays, named by their content, and the bytes that arrays take."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Shorts = NDArray[np.int32]
Marks = NDArray[np.bool_]


def bytes_of(held: object) -> int:
    """Bytes of all arrays that an object holds, in its attributes and items, each array once."""
    left, seen, total = [held], set[int](), 0
    while left:
        one = left.pop()
        if id(one) in seen:
            continue
        seen.add(id(one))
        if hasattr(one, "nbytes"):
            total += one.nbytes
        elif isinstance(one, dict):
            left += one.values()
        elif isinstance(one, tuple | list):
            left += one
        else:
            left += getattr(one, "__dict__", {}).values()
    return total
