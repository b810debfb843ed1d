"""The boundary conditions of a CGNS zone: which patch each is, and which nodes or elements it lists."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.files.cgns.tree import Node
from mesh_motion_server.files.mesh_file import IntArray

__all__ = ["Condition", "read_conditions"]


_OF_FACETS = ("FaceCenter", "EdgeCenter")


@dataclass(frozen=True, eq=False)
class Condition:
    """One boundary condition.

    Attributes
    ----------
    node : Node
    patch : str
    location : str
        Where it is said to be; Gmsh writes CellCenter for faces, too.
    of_nodes : bool
        Whether it lists nodes, and not elements.
    values : (k,) array
        Numbers from 1 on, or the first and the last of a range.
    is_range : bool
    """

    node: Node
    patch: str
    location: str
    of_nodes: bool
    values: IntArray
    is_range: bool

    def elements(self, numbers: IntArray) -> NDArray[np.bool_]:
        """Which of the elements with these numbers it lists."""
        if self.of_nodes:
            return np.zeros(len(numbers), dtype=bool)
        if self.is_range:
            within: NDArray[np.bool_] = (numbers >= self.values[0]) & (numbers <= self.values[1])
            return within
        return np.isin(numbers, self.values)

    def check(self, facets: IntArray, cells: IntArray, what: str) -> None:
        """See that all elements it lists are among those numbered ``facets``; or, of a volume, all among the ``cells``.

        Raises
        ------
        InvalidInput
            Naming the first that is no such element.
        """
        unknown = None if self.of_nodes else self._first_unknown(facets)
        of_a_volume = self.location not in _OF_FACETS and self._first_unknown(cells) is None
        if unknown is not None and not of_a_volume:
            raise self.node.refused(f"it names element {unknown}, which is no {what}")

    def _first_unknown(self, numbers: IntArray) -> int | None:
        """The first element it lists that none of the numbers is; a range may be longer than any array."""
        if not self.is_range:
            wrong = self.values[~np.isin(self.values, numbers)]
            return int(wrong[0]) if len(wrong) else None
        first, last = (int(v) for v in self.values)
        within = np.unique(numbers[self.elements(numbers)])
        gaps = np.flatnonzero(within != first + np.arange(len(within)))
        unknown = first + (int(gaps[0]) if len(gaps) else len(within))
        return unknown if unknown <= last else None

    @property
    def nodes(self) -> IntArray:
        """The nodes it lists, from 0 on."""
        if not self.of_nodes:
            return np.empty(0, dtype=np.int64)
        return np.arange(self.values[0] - 1, self.values[1]) if self.is_range else self.values - 1


def read_conditions(base: Node, zone: Node, n_points: int) -> list[Condition]:
    """All boundary conditions of a zone.

    Raises
    ------
    InvalidInput
        If one lists nothing, or nodes that do not exist.
    """
    return [_read(base, node, n_points) for group in zone.children("ZoneBC_t") for node in group.children("BC_t")]


def _read(base: Node, node: Node, n_points: int) -> Condition:
    """One of them; ``ElementList`` and ``ElementRange`` are those of old versions."""
    place = node.child("GridLocation")
    location = place.text() if place is not None else ""
    for name in ("PointList", "PointRange", "ElementList", "ElementRange"):
        if (listed := node.child(name)) is not None:
            break
    else:
        raise node.refused("neither PointList nor PointRange")
    values, is_range = listed.integers(), name.endswith("Range")
    of_nodes = location in ("", "Vertex") and name.startswith("Point")
    if is_range and (len(values) != 2 or values[0] > values[1]):
        raise node.refused(f"a {name} of {', '.join(map(str, values[:4].tolist()))}; expected the first and the last")
    wrong = values[(values < 1) | (values > n_points)] if of_nodes else values[:0]
    if len(wrong):
        raise node.refused(f"it names node {int(wrong[0])}, but there are the nodes 1 to {n_points}")
    return Condition(node, _patch_name(base, node), location, of_nodes, values, is_range)


def _patch_name(base: Node, condition: Node) -> str:
    """The family, or what the family in turn is named after, or the condition's own name."""
    node = condition.child("FamilyName")
    family = node.text() if node is not None else ""
    if not family:
        return condition.name
    described = base.child(family)
    names = described.children("FamilyName_t") if described is not None and described.label == "Family_t" else []
    return (names[0].text() if len(names) == 1 else "") or family
