"""The boundary conditions of a CGNS zone: the patch of each, and the nodes or elements that it lists."""

from dataclasses import dataclass

import numpy as np
from mesh_motion_numerics.arrays import Integers, Marks

from mesh_motion_server.files.cgns.tree import Node

_OF_FACETS = ("FaceCenter", "EdgeCenter")


@dataclass(frozen=True, eq=False)
class Condition:
    """One boundary condition."""

    node: Node
    patch: str
    location: str  # the grid location in the file; Gmsh writes CellCenter for faces, too
    of_nodes: bool  # whether it lists nodes (otherwise elements)
    values: Integers  # (k,). Numbers counted from 1, or the first and the last number of a range
    is_range: bool

    def elements(self, numbers: Integers) -> Marks:
        """Mask of those elements with these numbers that the condition lists."""
        if self.of_nodes:
            return np.zeros(len(numbers), dtype=bool)
        if self.is_range:
            within: Marks = (numbers >= self.values[0]) & (numbers <= self.values[1])
            return within
        return np.isin(numbers, self.values)

    def check(self, facets: Integers, cells: Integers, what: str) -> None:
        """Check that all listed elements are among the ``facets`` or, for a volume, among the ``cells`` (numbers).

        Raises InvalidInput if an element is not among them; names the first one.
        """
        unknown = None if self.of_nodes else self._first_unknown(facets)
        of_a_volume = self.location not in _OF_FACETS and self._first_unknown(cells) is None
        if unknown is not None and not of_a_volume:
            raise self.node.refused(f"it names element {unknown}, which is not {what}")

    def _first_unknown(self, numbers: Integers) -> int | None:
        """The first listed element that is not among the numbers; a range may be longer than any array."""
        if not self.is_range:
            wrong = self.values[~np.isin(self.values, numbers)]
            return int(wrong[0]) if len(wrong) else None
        first, last = (int(v) for v in self.values)
        within = np.unique(numbers[self.elements(numbers)])
        gaps = np.flatnonzero(within != first + np.arange(len(within)))
        unknown = first + (int(gaps[0]) if len(gaps) else len(within))
        return unknown if unknown <= last else None

    @property
    def nodes(self) -> Integers:
        """The listed nodes, counted from 0."""
        if not self.of_nodes:
            return np.empty(0, dtype=np.int64)
        return np.arange(self.values[0] - 1, self.values[1]) if self.is_range else self.values - 1


def read_conditions(base: Node, zone: Node, n_points: int) -> list[Condition]:
    """All boundary conditions of a zone.

    Raises InvalidInput if a condition lists nothing, or nodes that do not exist.
    """
    return [_read(base, node, n_points) for group in zone.children("ZoneBC_t") for node in group.children("BC_t")]


def _read(base: Node, node: Node, n_points: int) -> Condition:
    """Read one boundary condition; old versions of CGNS use ``ElementList`` and ``ElementRange``."""
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
    return Condition(node, patch_name(base, node), location, of_nodes, values, is_range)


def patch_name(base: Node, condition: Node) -> str:
    """The family name that the condition's family refers to, else the family, else the condition's own name."""
    node = condition.child("FamilyName")
    family = node.text() if node is not None else ""
    if not family:
        return condition.name
    described = base.child(family)
    names = described.children("FamilyName_t") if described is not None and described.label == "Family_t" else []
    return (names[0].text() if len(names) == 1 else "") or family
