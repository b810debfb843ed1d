from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
from mesh_motion_numerics.arrays import bytes_of


class Rows(NamedTuple):
    starts: np.ndarray
    data: np.ndarray


@dataclass
class Holder:
    rows: list[Rows]
    made: dict[str, np.ndarray] = field(default_factory=dict)
    itself: object = None


def test_each_array_counts_once_wherever_it_is_held() -> None:
    starts, data = np.arange(4), np.ones(10)
    holder = Holder([Rows(starts, data), Rows(starts, np.ones(3, dtype=np.float32))], {"again": data})
    holder.itself = holder
    assert bytes_of(holder) == starts.nbytes + data.nbytes + 12
    assert bytes_of((7, "text", None)) == 0


def test_an_object_that_knows_its_bytes_is_not_searched() -> None:
    assert bytes_of([SimpleNamespace(nbytes=100, more=np.ones(5))]) == 100


def test_what_is_made_later_counts_too() -> None:
    holder = Holder([])
    before = bytes_of(holder)
    holder.made["factor"] = np.ones((2, 2))
    assert (before, bytes_of(holder)) == (0, 32)
