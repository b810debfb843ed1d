"""How much memory packed data may take when they are unpacked: a small file must not fill the machine."""

from __future__ import annotations

__all__ = ["most_memory"]

#: Coordinates and lists of a mesh pack by a factor of 2 to 20.
_BEST_RATIO = 64
#: … but constant ones, as z in a plane, by any: so much is always allowed.
_ALWAYS = 1 << 30


def most_memory(packed: int) -> int:
    """Bytes that so many packed bytes, all of a file's or of one of its arrays, may become."""
    return max(_ALWAYS, _BEST_RATIO * packed)
