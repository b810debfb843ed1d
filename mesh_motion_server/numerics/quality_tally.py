"""Counts of quality values by bins: the sum, the extremes and the order statistics of millions of values.

All values lie in [-1, 1] (or are -inf). A value is remembered as a level, two bytes; a bin is sixteen levels. The
counts say in which bin a percentile is, the levels of the values in that bin in which level, and only the few values of
that level are looked at once more: exact percentiles without a sort, and without the values being kept.

Most cells of a mesh that moves a little have a relative size just below 1, so equal bins would put all of them into
one. With ``u = 1 - value`` the bins are equally wide for ``u ≥ 2⁻⁶`` and 32 to the octave below, down to the rounding
of numbers near 1 (u = 2⁻⁵³); the last one holds the ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from mesh_motion_server.numerics.read_only import read_only
from mesh_motion_server.numerics.thread_share import threads_for

__all__ = ["BINS", "PARTS", "Ranked", "Tally", "empty_tallies", "tally_chunk", "tally_three"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Levels = NDArray[np.uint16]
Counts = NDArray[np.int32]

#: Work items of the parallel passes: fixed, so that a sum does not depend on the number of threads.
PARTS = 64
#: Fewer are done before another thread is awake.
_VALUES_PER_THREAD = 50_000

# values that are looked at together
_GROUP = 32

_IN_BIN = 4  # bits of a level within its bin
_EQUAL_FROM = 2.0**-6  # the u from which on bins are equally wide …
_PER_UNIT = 2.0 ** (10 + _IN_BIN)  # … and how many levels there are in a unit of u
_SHIFT = 52 - 5 - _IN_BIN  # leaves the exponent and the leading bits of the fraction: 32 bins to the octave
_FIRST = (1023 - 53) << (5 + _IN_BIN)  # what is left of 2⁻⁵³, the smallest u > 0
_ONES = 1 << _IN_BIN  # levels of u = 0, of which the first is used: a bin of its own
_NEAR_ONE = _ONES + (53 - 6) * (32 << _IN_BIN)  # levels of u < 2⁻⁶
_OFFSET = _NEAR_ONE - int(_EQUAL_FROM * _PER_UNIT)
_TOP = _OFFSET + 2 * int(_PER_UNIT) + _ONES - 1  # the last level

#: Number of bins.
BINS = (_TOP >> _IN_BIN) + 1


@njit(cache=True, error_model="numpy", inline="always")
def level_of(value: float) -> int:
    """Level of a value in [-1, 1], ascending with the value; -inf goes to that of -1."""
    u = min(1.0 - value, 2.0)
    near = int(np.float64(u).view(np.int64) >> _SHIFT) - (_FIRST - _ONES)
    far = int(u * _PER_UNIT) + _OFFSET
    below: int = far if u >= _EQUAL_FROM else (near if u > 0.0 else 0)
    return _TOP - below


@njit(cache=True, error_model="numpy")
def tally_chunk(values, count, levels, counts, totals):  # type: ignore[no-untyped-def]
    """Add the first ``count`` values to counts (BINS,) and totals (sum, minimum, maximum); their levels are written."""
    for s in range(count):
        levels[s] = level_of(values[s])
    total, least, most = totals[0], totals[1], totals[2]
    for s in range(count):
        value = values[s]
        counts[levels[s] >> _IN_BIN] += 1
        total += value
        least = min(least, value)
        most = max(most, value)
    totals[0], totals[1], totals[2] = total, least, most


@njit(cache=True, error_model="numpy")
def tally_three(values, count, levels, counts, totals):  # type: ignore[no-untyped-def]
    """As tally_chunk for three rows of values together: each sum waits for its last term, three of them do not."""
    for k in range(3):
        for s in range(count):
            levels[k, s] = level_of(values[k, s])
    sum_a, sum_b, sum_c = totals[0, 0], totals[1, 0], totals[2, 0]
    least_a, least_b, least_c = totals[0, 1], totals[1, 1], totals[2, 1]
    most_a, most_b, most_c = totals[0, 2], totals[1, 2], totals[2, 2]
    for s in range(count):
        a, b, c = values[0, s], values[1, s], values[2, s]
        counts[0, levels[0, s] >> _IN_BIN] += 1
        counts[1, levels[1, s] >> _IN_BIN] += 1
        counts[2, levels[2, s] >> _IN_BIN] += 1
        sum_a += a
        sum_b += b
        sum_c += c
        least_a = min(least_a, a)
        least_b = min(least_b, b)
        least_c = min(least_c, c)
        most_a = max(most_a, a)
        most_b = max(most_b, b)
        most_c = max(most_c, c)
    totals[0, 0], totals[1, 0], totals[2, 0] = sum_a, sum_b, sum_c
    totals[0, 1], totals[1, 1], totals[2, 1] = least_a, least_b, least_c
    totals[0, 2], totals[1, 2], totals[2, 2] = most_a, most_b, most_c


@njit(cache=True, parallel=True)
def _tally_values(values, levels, counts, totals):  # type: ignore[no-untyped-def]
    m = values.size
    for part in prange(PARTS):
        first, last = part * m // PARTS, (part + 1) * m // PARTS
        tally_chunk(values[first:last], last - first, levels[first:last], counts[part], totals[part])


@njit(cache=True)
def _gather_part(levels, ranges, start, out):  # type: ignore[no-untyped-def]
    """Write ``start`` + the number of each value whose level is in one of three ranges (first level, width) to out.

    Most groups of values have none, which 16-bit vector operations find out.
    """
    low_a, low_b, low_c = ranges[0, 0], ranges[1, 0], ranges[2, 0]
    width_a, width_b, width_c = ranges[0, 1], ranges[1, 1], ranges[2, 1]
    place, whole = 0, levels.size // _GROUP * _GROUP
    for group in range(0, whole, _GROUP):
        found = np.uint16(0)
        for s in range(_GROUP):
            x = levels[group + s]
            in_a, in_b = np.uint16(x - low_a) < width_a, np.uint16(x - low_b) < width_b
            found = np.uint16(found | np.uint16(in_a | in_b | (np.uint16(x - low_c) < width_c)))
        if found:
            for s in range(_GROUP):
                x = levels[group + s]
                if np.uint16(x - low_a) < width_a or np.uint16(x - low_b) < width_b or np.uint16(x - low_c) < width_c:
                    out[place] = start + group + s
                    place += 1
    for e in range(whole, levels.size):
        x = levels[e]
        if np.uint16(x - low_a) < width_a or np.uint16(x - low_b) < width_b or np.uint16(x - low_c) < width_c:
            out[place] = start + e
            place += 1


@njit(cache=True, parallel=True)
def _gather_levels(levels, ranges, starts, out):  # type: ignore[no-untyped-def]
    """Numbers of the values whose level is in one of the ranges (3, 2); those of a part go to out from its start on."""
    m = levels.size
    for part in prange(PARTS):
        first, last = part * m // PARTS, (part + 1) * m // PARTS
        _gather_part(levels[first:last], ranges, first, out[starts[part] :])


def empty_tallies(count: int, m: int) -> tuple[Levels, Counts, Floats]:
    """The arrays of ``count`` tallies of m values before the first one: levels to be written, nothing counted.

    They are (count, m), (PARTS, count, BINS) and (PARTS, count, 3).
    """
    totals = np.zeros((PARTS, count, 3))
    totals[..., 1:] = np.inf, -np.inf
    return np.empty((count, m), dtype=np.uint16), np.zeros((PARTS, count, BINS), dtype=np.int32), totals


@dataclass(frozen=True, eq=False)
class Ranked:
    """Values with given ranks, as far as they are known without the values.

    Attributes
    ----------
    numbers : (s,) int64 array
        Of the values to be looked at.
    places : list of int
        Where in the ascending order of those each rank's value is; negative: it is the known one.
    known : float
    """

    numbers: Ints
    places: list[int]
    known: float

    def found(self, values: Floats) -> list[float]:
        """The values of the ranks, from the ``values`` (s,) of the numbers."""
        in_order = np.sort(values)
        return [self.known if place < 0 else float(in_order[place]) for place in self.places]


@dataclass(frozen=True, eq=False)
class Tally:
    """Counts of m values, by part and bin.

    Attributes
    ----------
    levels : (m,) uint16 array
        Level of each value.
    counts : (PARTS, BINS) int32 array
    totals : (PARTS, 3) array
        Sum, minimum and maximum of each part.
    """

    levels: Levels
    counts: Counts
    totals: Floats

    @classmethod
    def of(cls, values: Floats) -> Tally:
        """Of values (m,)."""
        levels, counts, totals = empty_tallies(1, len(values))
        with threads_for(len(values) // _VALUES_PER_THREAD):
            _tally_values(read_only(values), levels[0], counts[:, 0], totals[:, 0])
        return cls(levels[0], counts[:, 0], totals[:, 0])

    def __len__(self) -> int:
        return len(self.levels)

    @cached_property
    def total(self) -> Counts:
        """(BINS,) counts of all parts."""
        total: Counts = np.add.reduce(
            self.counts, axis=0, dtype=np.int32
        )  # a cast to 64 bits takes three times as long
        return total

    @property
    def least(self) -> float:
        """The smallest value."""
        return float(self.totals[:, 1].min())

    @property
    def mean(self) -> float:
        """Of the values."""
        return float(self.totals[:, 0].sum() / len(self))

    @property
    def is_constant(self) -> bool:
        """Whether all values are the same."""
        return bool(self.totals[:, 1].min() == self.totals[:, 2].max())

    def lowest(self, count: int) -> Ints:
        """Numbers, ascending, of values among which the ``count`` smallest are."""
        count = min(count, len(self))
        return self.numbers_in(np.arange(BINS) <= np.searchsorted(np.cumsum(self.total), count))

    def at_ranks(self, ranks: list[int]) -> Ranked:
        """Which values to look at for those with the given ranks, at most three, in ascending order."""
        if self.is_constant:  # a mesh at rest: every size is 1
            return Ranked(np.empty(0, dtype=np.int64), [-1] * len(ranks), self.least)
        total = self.total
        ends = np.cumsum(total)
        bins = np.searchsorted(ends, ranks, side="right")
        wanted = np.zeros(BINS, dtype=np.bool_)
        wanted[bins] = True
        wanted[-1] &= self.totals[:, 2].max() > 1.0  # otherwise they are ones
        numbers = self.numbers_in(wanted)
        chosen = np.where(wanted, total, 0)
        inside = np.array(ranks) - (ends - total)[bins] + (np.cumsum(chosen) - chosen)[bins]
        return _narrowed(numbers, self.levels[numbers], np.where(wanted[bins], inside, -1))

    def numbers_in(self, wanted: Bools) -> Ints:
        """Numbers, ascending, of the values in the wanted bins (BINS,), which are at most three runs of bins."""
        ends = np.flatnonzero(np.diff(wanted, prepend=False, append=False)).reshape(-1, 2)
        ranges = np.zeros((3, 2), dtype=np.uint16)
        ranges[: len(ends), 0] = ends[:, 0] << _IN_BIN
        ranges[: len(ends), 1] = (ends[:, 1] - ends[:, 0]) << _IN_BIN
        starts = np.concatenate([[0], np.cumsum(self.counts[:, wanted].sum(axis=1))])
        out = np.empty(starts[-1], dtype=np.int64)
        with threads_for(len(self) // _VALUES_PER_THREAD):
            _gather_levels(read_only(self.levels), ranges, starts, out)
        return out


def _narrowed(numbers: Ints, levels: Levels, inside: Ints) -> Ranked:
    """Of numbered values with these levels (s,), those that may be at the places ``inside`` of the ascending order.

    A negative place stands for one.
    """
    known = inside >= 0
    if not known.any():
        return Ranked(np.empty(0, dtype=np.int64), [-1] * len(inside), 1.0)
    in_order = np.sort(levels)
    wanted = np.unique(in_order[inside[known]])
    first = np.searchsorted(in_order, wanted)
    kept = np.searchsorted(in_order, wanted, side="right") - first
    level = np.searchsorted(wanted, in_order[np.where(known, inside, inside[known][0])])
    places = inside - first[level] + (np.cumsum(kept) - kept)[level]
    chosen = np.logical_or.reduce([levels == one for one in wanted])
    return Ranked(numbers[chosen], np.where(known, places, -1).tolist(), 1.0)
