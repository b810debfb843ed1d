"""A cache of factorizations with a byte budget: the coupling iterations of one step share one factorization."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from typing import Generic, Protocol, TypeVar

__all__ = ["FactorCache"]


class _Sized(Protocol):
    @property
    def nbytes(self) -> int: ...


F = TypeVar("F", bound=_Sized)


class FactorCache(Generic[F]):
    """Keeps the most recently used factorizations; keys are digests of all that determines one.

    Only time depends on it: what is dropped is made again, bitwise the same.

    Parameters
    ----------
    byte_budget : int
        What all kept factorizations may take together. The newest one is kept even if it is larger alone: it is the
        one that the next iteration asks for.
    """

    def __init__(self, byte_budget: int) -> None:
        self._budget = byte_budget
        self._kept: OrderedDict[bytes, F] = OrderedDict()
        self.made = 0
        self.reused = 0

    def __len__(self) -> int:
        return len(self._kept)

    @property
    def nbytes(self) -> int:
        """Bytes of all kept factorizations."""
        return sum(kept.nbytes for kept in self._kept.values())

    def get_or_make(self, key: bytes, make: Callable[[], F]) -> tuple[F, bool]:
        """The factorization of ``key``, and whether it was reused."""
        if key in self._kept:
            self._kept.move_to_end(key)
            self.reused += 1
            return self._kept[key], True
        # make room first: old and new together could pass the process's memory limit
        self._shrink(self._budget // 2)
        made = make()
        self._kept[key] = made
        self.made += 1
        self._shrink(self._budget, keep=1)
        return made, False

    def clear(self) -> None:
        """Drop all."""
        self._kept.clear()

    def _shrink(self, budget: int, keep: int = 0) -> None:
        """Drop the least recently used until ``budget`` bytes or ``keep`` entries are left."""
        while len(self._kept) > keep and self.nbytes > budget:
            self._kept.popitem(last=False)
