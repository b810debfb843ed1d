"""The headroom of MOVED in words: the same in the client, ``play``, the terminal and the page (SPEC.md, section 15)."""

from collections.abc import Mapping
from typing import Any

__all__ = ["headroom_in_words"]

#: Unit of the headroom for each way of continuing the motion.
_COUNTED = {
    "step": "more steps like the last one",
    "displacement": "times the displacement further",
    "velocity": "seconds of this velocity",
}
_ENDS = {"threshold": "the quality threshold", "inversion": "the first inverted cell"}


def headroom_in_words(headroom: Mapping[str, Any]) -> str:
    """Say how much more motion leads to which end of the mesh, and in which unit; empty if no end is near."""
    ahead = [f"{headroom[name]:.2g} to {end}" for name, end in _ENDS.items() if name in headroom]
    return f"{_COUNTED[headroom.get('along', 'step')]}: {', '.join(ahead)}" if ahead else ""
