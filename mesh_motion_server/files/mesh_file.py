"""A mesh from a file, in the file's node order, with the checks that apply to every reader."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeVar

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.mesh.boundary_facets import boundary_nodes
from mesh_motion_numerics.mesh.cells import CELL_TYPES, CellTable
from mesh_motion_protocol.errors import InvalidInput
from mesh_motion_protocol.flat_points import is_flat

from mesh_motion_server.files.collapsed import uncollapsed

Key = TypeVar("Key")

_KINDS = ("point", "curve", "surface", "volume")


@dataclass(frozen=True, eq=False)
class MeshFile:
    """A volume mesh with its boundary patches."""

    points: Floats  # (n, d), mesh length unit. Finite; d is the dimension of the cells; the file's node order
    #: (m, k) each. Cells of each type of :data:`.cells.CELL_TYPES`, all of dimension d, none empty.
    cells: dict[str, Integers]
    patches: dict[str, Integers]  # (p,) each. Node ids of each patch, ascending, each once
    path: Path  # the file that it was read from
    #: The role of each patch that the file marks: one side of a periodic pair, or a symmetry plane or axis.
    marked: Mapping[str, str] = field(default_factory=dict)
    zone: str = ""  # the zone of the file; "" in formats without zones
    notes: tuple[str, ...] = ()  # one line for each thing that the reader left out or named
    #: (n,). For a partition: the nodes' numbers in the whole mesh.
    global_ids: Integers | None = None

    @property
    def dimension(self) -> int:
        """1, 2 or 3."""
        return int(self.points.shape[1])

    @property
    def n_cells(self) -> int:
        """Number of cells of all types together."""
        return sum(len(nodes) for nodes in self.cells.values())

    @property
    def cell_table(self) -> CellTable:
        """The cells as a table for the numerics."""
        return CellTable.from_arrays(self.cells)

    def __post_init__(self) -> None:
        _check_points(self.points, self.path)
        _check_cells(self.cells, self.points.shape, self.path)
        for name, nodes in self.patches.items():
            _check_range(nodes, len(self.points), f"patch {name!r}", self.path)


def assemble(path: Path, points: Floats, cells: Mapping[str, Integers], patches: Mapping[str, Integers]) -> MeshFile:
    """Make a mesh from the content of a foreign file: cells of all dimensions, always three coordinates.

    The mesh has the cells of the highest dimension. Coordinates beyond it must be constant; they are dropped. Cells
    that name a node twice get simpler types. Raises InvalidInput without cells, if coordinates beyond the cells'
    dimension vary, and as :class:`MeshFile` does.
    """
    used = {name: np.asarray(nodes, dtype=np.int64) for name, nodes in cells.items() if len(nodes)}
    if not used:
        raise InvalidInput(f"{path}: the mesh has no cells", hint="was the mesh saved before it was generated?")
    dimension = max(CELL_TYPES[name].dimension for name in used)
    points = _drop_coordinates(np.asarray(points, dtype=np.float64), dimension, path)
    used, simpler = uncollapsed({n: nodes for n, nodes in used.items() if CELL_TYPES[n].dimension == dimension})
    nodes_of = {name: np.unique(nodes) for name, nodes in patches.items()}
    notes = ["the mesh is 1D, it has lines only: was the group of its surface or volume not saved?"] * (dimension == 1)
    notes += [f"{simpler} cells name a node twice: they are read as cells of simpler types"] * bool(simpler)
    return MeshFile(points, used, nodes_of, path, notes=tuple(notes))


def assemble_elements(
    path: Path, points: Floats, elements: Sequence[tuple[str, Integers]], patches: Mapping[str, Integers]
) -> MeshFile:
    """Do the same as :func:`assemble` with elements of types ("" for no cells), and nodes (m, k), corners first."""
    cells: dict[str, list[Integers]] = defaultdict(list)
    for name, nodes in elements:
        if name:
            cells[name].append(nodes[:, : CELL_TYPES[name].n_nodes])
    mesh = assemble(path, points, concatenated(cells), patches)
    own = ((nodes, CELL_TYPES[name].n_nodes) for name, nodes in elements if name in mesh.cells)
    higher = sum(len(nodes) for nodes, corners in own if nodes.shape[1] > corners)
    return replace(mesh, notes=(*mesh.notes, *by_corners(higher)))


def all_outside(elements: Sequence[tuple[str, Integers]], count: int) -> bool:
    """Whether all ``count`` nodes are on the boundary of the elements in space: our type, and nodes (m, k)."""
    solids: dict[str, list[Integers]] = defaultdict(list)
    for name, nodes in elements:
        if name and CELL_TYPES[name].dimension == 3:
            solids[name].append(nodes[:, : CELL_TYPES[name].n_nodes])
    return bool(solids) and len(boundary_nodes(CellTable.from_arrays(concatenated(solids)))) == count


def concatenated(parts: Mapping[Key, Sequence[Integers]]) -> dict[Key, Integers]:
    """The parts under each key as one array."""
    return {key: np.concatenate(some) for key, some in parts.items()}


def by_name(found: Mapping[str, Sequence[tuple[int, Integers]]]) -> tuple[dict[str, Integers], list[str]]:
    """{patch: (p,) nodes, with repeats} of groups of several dimensions, and a note on each name that is not one group.

    A curve with the name of the surface on which it lies gives no note; a curve elsewhere may be meant as another
    patch.
    """
    patches, notes = concatenated({name: [nodes for _, nodes in parts] for name, parts in found.items()}), []
    for name, every in found.items():
        parts = [part for part in every if len(part[1])] or every
        most = max(dimension for dimension, _ in parts)
        of_most = np.concatenate([nodes for dimension, nodes in parts if dimension == most])
        others = [(dimension, np.setdiff1d(nodes, of_most)) for dimension, nodes in parts]
        for lower in sorted({dimension for dimension, own in others if len(own)}):
            count = len(np.unique(np.concatenate([own for dimension, own in others if dimension == lower])))
            notes.append(
                f"{name!r} is the name of a {_KINDS[most]} and of a {_KINDS[lower]} with {count} other nodes: they are "
                "one patch; give one of them another name if they are two"
            )
    return patches, notes


def by_corners(count: int) -> list[str]:
    """The note on cells of higher order."""
    return [f"{count} cells of higher order are moved and judged by their corners; their other nodes move along"] * (
        count > 0
    )


def group_names(groups: Iterable[tuple[int, int]], names: Mapping[tuple[int, int], str]) -> dict[tuple[int, int], str]:
    """The patch of each group (dimension, number): its name or number; curves and surfaces are numbered separately.

    Without names, the group of the highest dimension with a number is the patch ``"1"``, others are ``"curve_1"``.
    """
    found = {group: names[group] for group in groups if group in names}
    taken = set(found.values())
    for dimension, number in sorted(set(groups) - set(found), reverse=True):
        name = str(number) if str(number) not in taken else f"{_KINDS[dimension]}_{number}"
        found[dimension, number] = name
        taken.add(name)
    return found


def named_groups(found: Mapping[tuple[int, int | str], Integers]) -> dict[str, list[tuple[int, Integers]]]:
    """Nodes (p,) by a group's dimension, and its number or name → the same by name, as :func:`by_name` takes them."""
    names = group_names([(of, group) for of, group in found if not isinstance(group, str)], {})
    named: dict[str, list[tuple[int, Integers]]] = defaultdict(list)
    for (dimension, group), nodes in found.items():
        named[group if isinstance(group, str) else names[dimension, group]].append((dimension, nodes))
    return named


def chosen_zone(path: Path, names: Sequence[str], zone: str) -> str:
    """The requested zone of a file, by its name or its number from 1; "" selects a single zone.

    Raises InvalidInput if there is no such zone; names the zones of the file.
    """
    if not zone and len(names) == 1:
        return names[0]
    if zone in names:
        return zone
    if zone.isdecimal() and 1 <= int(zone) <= len(names):
        return names[int(zone) - 1]
    listed = ", ".join(names[:8]) + (", …" if len(names) > 8 else "")
    asked = f"no zone {zone!r}; " if zone else ""
    raise InvalidInput(
        f"{path}: {asked}{len(names)} zone{'s' if len(names) > 1 else ''}: {listed}",
        hint='choose one: zone = "…" in [mesh] of the case, --zone of check and convert' if names else "",
    )


def _drop_coordinates(points: Floats, dimension: int, path: Path) -> Floats:
    """(n, dimension) the coordinates in use; those beyond the cells' dimension may differ by rounding only."""
    if points.ndim != 2 or points.shape[1] < dimension:
        raise InvalidInput(f"{path}: {dimension}D cells, but points of shape {points.shape}")
    _check_points(points, path)
    if not is_flat(points, dimension):
        extra = points[:, dimension:]
        raise InvalidInput(
            f"{path}: the cells are {dimension}D, but the coordinate {'xyz'[dimension]} varies "
            f"between {extra[:, 0].min():g} and {extra[:, 0].max():g}",
            hint="a 2D mesh lies in the x-y plane; a 3D mesh needs volume cells: save the volume's physical group too"
            if dimension == 2
            else "the file has lines only: save the physical group of the surface or the volume too",
        )
    return np.ascontiguousarray(points[:, :dimension])


def _check_points(points: Floats, path: Path) -> None:
    """Check that the coordinates are finite and have 1 to 3 dimensions."""
    if points.ndim == 2 and not len(points):
        raise InvalidInput(f"{path}: the mesh is empty: it has no nodes", code="INVALID_ARGUMENT.SHAPE")
    if points.ndim != 2 or points.shape[1] not in (1, 2, 3):
        raise InvalidInput(
            f"{path}: expected points of shape (n, 1 | 2 | 3), got {points.shape}", code="INVALID_ARGUMENT.SHAPE"
        )
    finite = np.isfinite(points)
    if not finite.all():
        node, axis = (int(i) for i in np.argwhere(~finite)[0])
        value = float(points[node, axis])
        raise InvalidInput(
            f"{path}: node {node} has {'xyz'[axis]} = {value}; coordinates must be finite",
            code="INVALID_ARGUMENT.NONFINITE",
            details={"node": node, "value": str(value)},
        )


def _check_cells(cells: Mapping[str, Integers], shape: tuple[int, ...], path: Path) -> None:
    """Refuse a mesh without cells, cells of another dimension than the points, and node ids that do not exist."""
    try:
        table = CellTable.from_arrays(cells)
    except InvalidInput as error:
        raise InvalidInput(f"{path}: {error.message}", code=error.code, hint=error.hint) from None
    if table.dimension != shape[1]:
        raise InvalidInput(f"{path}: {table.dimension}D cells, but points with {shape[1]} coordinates")
    for name, nodes in cells.items():
        _check_range(nodes, shape[0], f"cells of type {name!r}", path)


def _check_range(nodes: Integers, n_points: int, what: str, path: Path) -> None:
    """Refuse node ids outside 0 … n_points - 1."""
    wrong = (nodes < 0) | (nodes >= n_points)
    if wrong.any():
        where = np.argwhere(wrong)[0]
        raise InvalidInput(
            f"{path}: {what}: row {int(where[0])} names node {int(nodes[tuple(where)])}, "
            f"but the mesh has the nodes 0 to {n_points - 1}"
        )
