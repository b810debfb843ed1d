"""A cache with a byte budget for data that depend only on a mesh state, shared by the coupling iterations of a step."""

from collections import Counter, OrderedDict
from collections.abc import Callable
from typing import TypeVar, cast

from mesh_motion_numerics.arrays import bytes_of

K = TypeVar("K")


class FactorCache:
    """Keeps the most recently used factorizations and other data; a key is the digest of all inputs of an entry.

    The cache changes only the run time: a dropped entry is made again, bitwise the same.

    Parameters
    ----------
    byte_budget : int
        Limit for all entries together, of every kind. The newest entry is kept even if it alone is larger, because the
        next iteration needs it.

    Attributes
    ----------
    made, reused : Counter
        Number of entries that were made and reused, by kind.
    """

    def __init__(self, byte_budget: int) -> None:
        self._budget = byte_budget
        self._kept: OrderedDict[tuple[str, bytes], object] = OrderedDict()
        self._sizes: dict[tuple[str, bytes], int] = {}  # in bytes, when made and after each commit: some entries grow
        self._used: set[tuple[str, bytes]] = set()
        self.made: Counter[str] = Counter()
        self.reused: Counter[str] = Counter()

    def __len__(self) -> int:
        return len(self._kept)

    @property
    def nbytes(self) -> int:
        """Bytes of all entries."""
        return sum(self._sizes.values())

    def held(self) -> dict[str, int]:
        """Bytes of the entries of each kind."""
        held: Counter[str] = Counter()
        for (kind, _), size in self._sizes.items():
            held[kind] += size
        return dict(held)

    def report(self) -> dict[str, dict[str, int]]:
        """Bytes kept, number made and number reused, by kind."""
        held = self.held()
        return {
            kind: {"bytes": held.get(kind, 0), "made": made, "reused": self.reused[kind]}
            for kind, made in self.made.items()
        }

    def get_or_make(self, key: bytes, make: Callable[[], K], kind: str = "factorization") -> tuple[K, bool]:
        """Return the entry of this ``kind`` for ``key``, and whether it was reused."""
        place = (kind, key)
        self._used.add(place)
        if place in self._kept:
            self._kept.move_to_end(place)
            self.reused[kind] += 1
            return cast(K, self._kept[place]), True
        # make room first: old and new entries together could exceed the process's memory limit
        self._shrink(self._budget // 2)
        made = make()
        self._kept[place], self._sizes[place] = made, bytes_of(made)
        self.made[kind] += 1
        self._shrink(self._budget, keep=1)
        return made, False

    def next_step(self) -> None:
        """After a commit, drop the entries that the step has not used; they belong to states that never come back."""
        for place in self._kept.keys() - self._used:
            del self._kept[place]
        self._sizes = {place: bytes_of(kept) for place, kept in self._kept.items()}
        self._used = set()

    def clear(self) -> None:
        """Drop all entries."""
        self._kept.clear()
        self._sizes.clear()
        self._used = set()

    def _shrink(self, budget: int, keep: int = 0) -> None:
        """Drop the least recently used entries until ``budget`` bytes or ``keep`` entries are left."""
        while len(self._kept) > keep and self.nbytes > budget:
            place, _ = self._kept.popitem(last=False)
            del self._sizes[place]
