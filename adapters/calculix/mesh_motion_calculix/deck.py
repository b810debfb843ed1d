"""The user's input deck: its lines with included files inserted, its nodes and its node sets.

Only the cards that the coupling needs are read (``*NODE``, ``*NSET``, ``*INCLUDE``); all others go to CalculiX
unchanged.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mesh_motion_calculix.errors import DeckError

__all__ = ["Deck", "read_deck"]

#: A deck with deeper *INCLUDE cards probably includes itself.
_DEEPEST_INCLUDE = 8
_FORBIDDEN = {
    "*STEP": "give the model alone: the adapter writes the steps",
    "*RESTART": "the adapter writes and reads the restart files",
}


@dataclass(frozen=True)
class Deck:
    """A model without steps.

    Attributes
    ----------
    lines : tuple of str
        The deck, with included files inserted.
    points : dict of int to (3,) array
        Coordinates by CalculiX' node number (1-based), mesh length unit.
    sets : dict of str to (k,) int64 array
        Node numbers of each set, ascending, by name in capitals.
    """

    lines: tuple[str, ...]
    points: dict[int, NDArray[np.float64]]
    sets: dict[str, NDArray[np.int64]]

    def node_set(self, name: str) -> NDArray[np.int64]:
        """Node numbers of a set.

        Raises
        ------
        DeckError
            No set of that name, an empty one, or one with a node that the deck does not define.
        """
        nodes = self.sets.get(name.upper())
        if nodes is None or not len(nodes):
            known = ", ".join(sorted(self.sets)) or "none"
            raise DeckError(f"the deck has no node set {name.upper()} with nodes in it", f"its sets: {known}")
        unknown = [int(node) for node in nodes if int(node) not in self.points]
        if unknown:
            raise DeckError(f"node {unknown[0]} of set {name.upper()} is not defined by any *NODE of the deck")
        return nodes


def read_deck(path: Path) -> Deck:
    """Read a deck and the files that it includes.

    Raises
    ------
    DeckError
        A file is missing, a line of nodes or of a set cannot be read, or the deck has steps of its own.
    """
    lines = tuple(_flattened(Path(path), 0))
    points: dict[int, NDArray[np.float64]] = {}
    sets: dict[str, set[int]] = {}
    for keyword, options, data in _cards(lines):
        if keyword in _FORBIDDEN:
            raise DeckError(f"the deck {path} has a {keyword} card", _FORBIDDEN[keyword])
        try:
            if keyword == "*NODE":
                _read_nodes(data, options.get("NSET"), points, sets)
            elif keyword == "*NSET":
                _read_set(data, options, sets)
        except ValueError as error:
            raise DeckError(f"the deck {path}, card {keyword}: {error}") from None
    if not points:
        raise DeckError(f"the deck {path} has no *NODE card with nodes")
    return Deck(lines, points, {name: np.array(sorted(nodes), dtype=np.int64) for name, nodes in sets.items()})


def _flattened(path: Path, depth: int) -> Iterator[str]:
    """The lines of a file without comments, with the lines of included files in place of the includes."""
    if depth > _DEEPEST_INCLUDE:
        raise DeckError(f"{path} is included {depth} files deep", "an *INCLUDE of itself?")
    try:
        text = path.read_text()
    except (OSError, UnicodeDecodeError) as error:
        raise DeckError(f"the deck {path} cannot be read: {error}") from None
    for line in text.splitlines():
        if line.startswith("**") or not line.strip():
            continue
        keyword, options = _keyword(line)
        if keyword != "*INCLUDE":
            yield line
            continue
        name = options.get("INPUT", "").strip("\"'")
        yield from _flattened(path.parent / name, depth + 1)


def _keyword(line: str) -> tuple[str, dict[str, str]]:
    """The keyword of a card and its parameters; keyword and parameter names in capitals."""
    head, *rest = (part.strip() for part in line.split(","))
    pairs = (part.partition("=") for part in rest if part)
    return head.upper(), {name.strip().upper(): value.strip() for name, _, value in pairs}


def _cards(lines: tuple[str, ...]) -> Iterator[tuple[str, dict[str, str], list[list[str]]]]:
    """Each card: keyword, parameters, its data lines as fields."""
    card: tuple[str, dict[str, str], list[list[str]]] | None = None
    for line in lines:
        if line.startswith("*"):
            if card:
                yield card
            card = (*_keyword(line), [])
        elif card:
            card[2].append([field.strip() for field in line.split(",") if field.strip()])
    if card:
        yield card


def _read_nodes(
    data: list[list[str]], name: str | None, points: dict[int, NDArray[np.float64]], sets: dict[str, set[int]]
) -> None:
    """Nodes of one card; coordinates that are left out are zero, as in CalculiX."""
    for fields in data:
        number = int(fields[0])
        values = [float(field.upper().replace("D", "E")) for field in fields[1:4]]
        points[number] = np.array([*values, 0.0, 0.0, 0.0][:3])
        if name:
            sets.setdefault(name.upper(), set()).add(number)


def _read_set(data: list[list[str]], options: dict[str, str], sets: dict[str, set[int]]) -> None:
    """Members of one card: numbers, other sets, or ranges."""
    if "NSET" not in options:
        raise ValueError("it has no NSET=name")
    members = sets.setdefault(options["NSET"].upper(), set())
    for fields in data:
        if "GENERATE" in options:
            first, last, *step = (int(field) for field in fields)
            members.update(range(first, last + 1, *(step or [1])))
            continue
        for field in fields:
            members.update([int(field)] if field.lstrip("+-").isdigit() else _other(field, sets))


def _other(name: str, sets: dict[str, set[int]]) -> set[int]:
    """The nodes of a set that is a member of another set."""
    if name.upper() not in sets:
        raise ValueError(f"{name} is neither a node number nor a set defined before it")
    return sets[name.upper()]
