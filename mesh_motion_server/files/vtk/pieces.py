"""Pieces of a VTK mesh: the parts of a parallel run, in one ``.vtu`` or in the files that a ``.pvtu`` lists.

Each piece has its own nodes, so nodes on common sides are repeated. Nodes of two pieces at one place become one node.
The mesh has the nodes in the order of the pieces, each at its first occurrence. Ghost cells, which belong to another
piece, are left out.

https://docs.vtk.org/en/latest/design_documents/VTKFileFormats.html
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.files.mesh_file import concatenated

#: The dimension of a group, and its number or its name.
PatchKey = tuple[int, int | str]


@dataclass(frozen=True, eq=False)
class VtkPiece:
    """Nodes (n, 3), cells (m, k) of each type, and the nodes of each patch, with repeats."""

    points: Floats
    cells: dict[str, Integers]
    patches: dict[PatchKey, Integers]


def sources(path: Path) -> list[Path]:
    """The files of a ``.pvtu``. Raises InvalidInput if it is not such a list."""
    try:
        root = ElementTree.parse(path).getroot()
    except ElementTree.ParseError as error:
        raise InvalidInput(f"{path}: not readable as .pvtu: {error}") from None
    found = [path.parent / piece.get("Source", "") for piece in root.iter("Piece")]
    if root.get("type") != "PUnstructuredGrid":
        raise InvalidInput(f"{path}: expected a PUnstructuredGrid, got {root.get('type') or root.tag}")
    if not found:
        raise InvalidInput(f"{path}: it lists no piece")
    for source in found:
        if source.suffix.lower() != ".vtu":
            raise InvalidInput(f"{path}: expected pieces in .vtu files, got {str(source)!r}")
        if not source.is_file():
            raise InvalidInput(f"{path}: its piece {source} is missing", hint="keep the files of all pieces with it")
    return found


def joined(path: Path, pieces: Sequence[VtkPiece]) -> tuple[VtkPiece, list[str]]:
    """Join all pieces to one mesh; return it and a note about the joined nodes.

    Raises InvalidInput if a piece has two nodes at one place where another piece has one, too: names them.
    """
    if len(pieces) == 1:
        return pieces[0], []
    first = np.cumsum([0, *(len(piece.points) for piece in pieces)])
    number, kept = numbering(path, np.concatenate([piece.points for piece in pieces]), first)
    points = np.concatenate([piece.points for piece in pieces])[kept]
    whole = renumbered(pieces, number, points)
    return whole, [f"{len(pieces)} pieces were joined; {int(first[-1]) - len(points)} nodes were in several of them"]


def renumbered(pieces: Sequence[VtkPiece], number: Integers, points: Floats) -> VtkPiece:
    """All pieces in one mesh with ``points``; ``number`` (n,) is the new number of each node, piece after piece."""
    cells: dict[str, list[Integers]] = defaultdict(list)
    patches: dict[PatchKey, list[Integers]] = defaultdict(list)
    start = 0
    for piece in pieces:
        for name, nodes in piece.cells.items():
            cells[name].append(number[start + nodes])
        for key, nodes in piece.patches.items():
            patches[key].append(number[start + nodes])
        start += len(piece.points)
    return VtkPiece(points, concatenated(cells), concatenated(patches))


def numbering(path: Path, points: Floats, first: Integers) -> tuple[Integers, Integers]:
    """The new number (n,) of each node of all pieces, and (k,) the nodes that are kept."""
    finite = np.isfinite(points).all(axis=1)
    if not finite.all():
        lost = int(np.searchsorted(first, np.argmin(finite), side="right"))
        raise InvalidInput(f"{path}: piece {lost} has a node without finite coordinates")
    from mesh_motion_numerics.mesh.coincidence import first_at_place  # noqa: PLC0415 - needs scipy

    place = first_at_place(points, float(np.ptp(points, axis=0).max()))
    piece = np.repeat(np.arange(len(first) - 1), np.diff(first))
    pairs, counts = np.unique(np.column_stack([place, piece]), axis=0, return_counts=True)
    shared = np.bincount(pairs[:, 0], minlength=len(points)) > 1
    double = pairs[(counts > 1) & shared[pairs[:, 0]]]
    if len(double):
        nodes = np.flatnonzero((place == double[0, 0]) & (piece == double[0, 1])) - first[double[0, 1]]
        raise InvalidInput(
            f"{path}: piece {double[0, 1] + 1} has its nodes {nodes[0]} and {nodes[1]} at one place, and another "
            "piece has a node there: the file does not say which of the two nodes it is",
            hint="save the mesh as one piece",
        )
    place = np.where(shared[place], place, np.arange(len(points)))
    kept = np.flatnonzero(place == np.arange(len(points)))
    return np.searchsorted(kept, place), kept
