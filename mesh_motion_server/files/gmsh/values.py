"""The numbers of one section of a Gmsh file, ASCII or binary, in the order of the format."""

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers, Marks
from numpy.typing import NDArray

from mesh_motion_server.files.moved import Place
from mesh_motion_server.files.text import integer, number_array


def end_of(data: bytes, name: bytes, start: int) -> int:
    """The place of the end mark of a section that begins before ``start``."""
    if (found := data.find(b"$End" + name, start)) < 0:
        raise ValueError(f"section ${name.decode()} does not end")
    return found


class Values(Protocol):
    """A cursor over a section's numbers.

    Raises ValueError when the section ends early or has something that is not a number.
    """

    @property
    def end(self) -> int:
        """Position in the file after the values taken so far, before the section's end mark."""

    def place(self, count: int, columns: int, tags: int = 0) -> Place:
        """The place of the next ``count`` rows of ``tags`` C ``int`` values and ``columns`` doubles."""

    def require_end(self, name: str) -> None:
        """Refuse a section ``name`` that has more values than it announces."""

    def ints(self, count: int) -> Integers:
        """The next C ``int`` values."""

    def sizes(self, count: int) -> Integers:
        """The next ``size_t`` values."""

    def doubles(self, count: int) -> Floats:
        """The next ``double`` values."""

    def text_count(self) -> int:
        """A count, which is text in ASCII and in binary files (version 2.2)."""

    def numbered_points(self, count: int) -> tuple[Integers, Floats]:
        """``count`` nodes of version 2.2: tags (count,) and coordinates (count, 3)."""

    def element_run(self, nodes_of: Callable[[int], int]) -> tuple[int, int, Integers]:
        """Consecutive elements of version 2.2 with the same type and number of tags.

        ``nodes_of`` gives the number of nodes of a type. Returns the type, the number of tags, and one row for each
        element: its tags, then its nodes.
        """


class AsciiValues:
    """Numbers of an ASCII section; integers up to 2⁵³ survive as float64."""

    def __init__(self, data: bytes, start: int, name: bytes) -> None:
        self._start, self._stop = start, end_of(data, name, start)
        self._values = number_array(data[start : self._stop].split(), np.float64)
        self._next = 0

    @property
    def end(self) -> int:
        return self._stop

    def place(self, count: int, columns: int, tags: int = 0) -> Place:
        return Place(count, self._next + tags, columns + tags, text=(self._start, self._stop))

    def require_end(self, name: str) -> None:
        if self._next < len(self._values):
            raise ValueError(f"section ${name} has {len(self._values) - self._next} more values than it announces")

    def doubles(self, count: int) -> Floats:
        first, self._next = self._next, self._next + count
        if self._next > len(self._values) or count < 0:
            raise ValueError("a section ends before all of its values")
        return self._values[first : self._next]

    def ints(self, count: int) -> Integers:
        return self.doubles(count).astype(np.int64)

    sizes = ints

    def text_count(self) -> int:
        return int(self.ints(1)[0])

    def numbered_points(self, count: int) -> tuple[Integers, Floats]:
        rows = self.doubles(count * 4).reshape(count, 4)
        return rows[:, 0].astype(np.int64), rows[:, 1:]

    def element_run(self, nodes_of: Callable[[int], int]) -> tuple[int, int, Integers]:
        first = self._next
        _, code, n_tags = (int(v) for v in self.ints(3))
        width = 3 + n_tags + nodes_of(code)
        window, run = 32, 0
        while run == window // 2 or run == 0:  # the run filled the last window: continue
            rows = self._values[first : first + window * width]
            rows = rows[: len(rows) // width * width].reshape(-1, width)
            run = _leading((rows[:, 1] == code) & (rows[:, 2] == n_tags))
            window *= 2
        self._next = first
        return code, n_tags, self.ints(run * width).reshape(run, width)[:, 3:]


def _leading(matches: Marks) -> int:
    """Number of values at the front that are true."""
    if matches.all():
        return max(1, len(matches))
    return int(np.argmin(matches))


class BinaryValues:
    """Numbers of a binary section."""

    def __init__(self, data: bytes, start: int, order: str, word: int) -> None:
        self._data = data
        self._next = start
        self._order = order
        self._size = np.dtype(f"{order}u{word}")

    @property
    def end(self) -> int:
        return self._next

    def place(self, count: int, columns: int, tags: int = 0) -> Place:
        return Place(count, self._next + 4 * tags, 8 * columns + 4 * tags, dtype=f"{self._order}f8")

    def require_end(self, name: str) -> None:
        if not self._data[self._next : self._next + 8].lstrip().startswith(b"$End"):
            raise ValueError(f"section ${name} has more values than it announces")

    def _take(self, dtype: np.dtype[np.generic], count: int) -> NDArray[np.generic]:
        first, self._next = self._next, self._next + count * dtype.itemsize
        if self._next > len(self._data) or count < 0:
            raise ValueError("a section ends before all of its values")
        return np.frombuffer(self._data, dtype, count, first)

    def ints(self, count: int) -> Integers:
        return self._take(np.dtype(f"{self._order}i4"), count).astype(np.int64)

    def sizes(self, count: int) -> Integers:
        return self._take(self._size, count).astype(np.int64)

    def doubles(self, count: int) -> Floats:
        return self._take(np.dtype(f"{self._order}f8"), count).astype(np.float64)

    def text_count(self) -> int:
        stop = self._data.index(b"\n", self._next)
        count = integer(self._data[self._next : stop])
        self._next = stop + 1
        return count

    def numbered_points(self, count: int) -> tuple[Integers, Floats]:
        record = np.dtype([("tag", f"{self._order}i4"), ("xyz", f"{self._order}f8", (3,))])
        rows: NDArray[Any] = self._take(record, count)
        return rows["tag"].astype(np.int64), rows["xyz"].astype(np.float64)

    def element_run(self, nodes_of: Callable[[int], int]) -> tuple[int, int, Integers]:
        code, count, n_tags = (int(v) for v in self.ints(3))
        width = 1 + n_tags + nodes_of(code)
        return code, n_tags, self.ints(count * width).reshape(count, width)[:, 1:]
