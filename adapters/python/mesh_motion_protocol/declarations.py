"""Markers for the fields of messages, in addition to the type: lengths, choices, ranges, arrays.

The markers stand in ``Annotated[...]`` in :mod:`.messages`; :mod:`.schema` reads them, so that the decoder's checks,
SPEC.md's tables and the vectors have one source.
"""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["ArrayField", "Choice", "Length", "Range"]


@dataclass(frozen=True)
class ArrayField:
    """Declares an array field: its dtype on the wire and the names of its axes (SPEC.md says what they are).

    ``dtype`` ``"<f8"`` also admits ``"<f4"``, which is widened on receipt; ``"<i8"`` also admits ``"<i4"``, which is
    widened unless ``narrow`` leaves it to the reader of the message: the cells take most of a mesh's memory.
    """

    dtype: str
    axes: tuple[str, ...]
    required: bool = True
    narrow: bool = False


@dataclass(frozen=True)
class Length:
    """Bytes of exactly the length ``exactly``, or bytes or text (UTF-8) of at most ``at_most`` bytes."""

    exactly: int | None = None
    at_most: int | None = None


@dataclass(frozen=True)
class Choice:
    """Text that must be one of ``values``."""

    values: tuple[str, ...]


@dataclass(frozen=True)
class Range:
    """An integer between ``low`` and ``high``, both allowed."""

    low: int
    high: int
