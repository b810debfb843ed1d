"""Rows of what a file numbers: numbers may be sparse and in any order."""

import numpy as np

from mesh_motion_server.numerics.arrays import Integers

__all__ = ["rows_of"]


def rows_of(numbers: Integers, named: Integers, what: str) -> Integers:
    """Rows in ``numbers`` (n,) of the numbers ``named``, in the shape of these.

    Raises
    ------
    ValueError
        If a number is not there, or twice; ``what`` is the word for it: "node".
    """
    order = np.argsort(numbers, kind="stable")
    ascending = numbers[order]
    if len(twice := ascending[1:][np.diff(ascending) == 0]):
        raise ValueError(f"{what} {int(twice[0])} appears twice")
    places = np.minimum(np.searchsorted(ascending, named), max(len(numbers) - 1, 0))
    wrong = ascending[places] != named if len(numbers) else np.ones(named.shape, bool)
    if wrong.any():
        raise ValueError(f"{what} {int(named[wrong][0])} is named, but is not there")
    rows: Integers = order[places]
    return rows
