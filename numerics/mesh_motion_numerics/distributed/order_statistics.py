"""Exact percentiles of values on many machines; the bytes sent do not grow with the number of values.

Each machine counts its values in 2048 bins of an interval. The sums of the counts show which bin has the value of a
rank. That bin is divided again, until it has so few different values that they are sent themselves. A bin is named by
the divisions that lead to it, not by its limits, so that all machines agree on its content to the last bit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mesh_motion_kernels as kernels
import numpy as np
from numpy.typing import NDArray

from mesh_motion_numerics.arrays import Floats, Integers

BINS = 2048
#: Largest number of values in a bin that are sent one by one.
FEW = 512
#: After this many divisions a bin of [-1, 1] is narrower than the distance of two numbers: it has one value, or zeros.
_DEEPEST = 6

Division = tuple[float, float, int]
"""Lower limit, bins per unit, bin."""

Way = tuple[Division, ...]
"""The path to a bin from all values: the divisions one after the other."""

WHOLE: Way = ()
"""All values."""


@dataclass(frozen=True, eq=False)
class BinContent:
    """The values of one machine in a bin."""

    #: parts, counts: (c,) uint16, (c,) uint32. Parts of the bin that have values, and the number of values in each.
    bins: NDArray[np.uint16]
    counts: NDArray[np.uint32]
    #: values, repeated: (v,) arrays or None. The different values, ascending, and how often each occurs, if there are
    #: few
    values: Floats | None
    repeated: Integers | None


def content(values: Floats, way: Way) -> BinContent:
    """Return the part of the values (m,) of a metric that is in the bin at the end of a way."""
    for low, scale, wanted in way:
        values = kernels.values_in_bin(values, low, scale, BINS, wanted)
    low, scale = _division(way)
    counts = np.zeros(BINS, dtype=np.int64)
    kernels.count_in_bins(values, low, scale, counts)
    filled = np.flatnonzero(counts)
    few = len(values) <= FEW or len(way) >= _DEEPEST or (len(filled) == 1 and values.min() == values.max())
    different, repeated = np.unique(values, return_counts=True) if few else (None, None)
    return BinContent(filled.astype(np.uint16), counts[filled].astype(np.uint32), different, repeated)


def _division(way: Way) -> tuple[float, float]:
    """Return the lower limit of a bin, and the number of its parts per unit."""
    if not way:
        return -1.0, 0.5 * BINS
    low, scale, wanted = way[-1]
    return low + wanted / scale, scale * BINS


def merged_counts(contents: Sequence[BinContent]) -> Integers:
    """(BINS,) counts of all machines."""
    total = np.zeros(BINS, dtype=np.int64)
    for one in contents:
        total[one.bins] += one.counts
    return total


def narrowed(way: Way, rank: int, contents: Sequence[BinContent]) -> tuple[Way, int] | float:
    """Divide once more towards the value of a rank among those of a bin, counted from 0.

    Returns
    -------
    (way, rank) of the part that holds it, or the value.
    """
    if all(one.values is not None for one in contents):
        values = np.concatenate([one.values for one in contents if one.values is not None])
        repeated = np.concatenate([one.repeated for one in contents if one.repeated is not None])
        order = np.argsort(values, kind="stable")
        return float(values[order][np.searchsorted(np.cumsum(repeated[order]), rank, side="right")])
    below = np.cumsum(merged_counts(contents))
    part = int(np.searchsorted(below, rank, side="right"))
    low, scale = _division(way)
    return (*way, (low, scale, part)), rank - (int(below[part - 1]) if part else 0)
