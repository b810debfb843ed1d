"""Polyhedral zones of CGNS as meshes by faces: NGON_n sections are the faces, NFACE_n or their parents the cells."""

from dataclasses import dataclass

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers

from mesh_motion_server.files.cgns.elements import NFACE, NGON, ListedElements
from mesh_motion_server.files.cgns.tree import Node
from mesh_motion_server.files.polyhedra.face_mesh import FaceMesh, from_sides


@dataclass(frozen=True, eq=False)
class NumberedFaces:
    """A mesh by faces, and the element number of each face in the zone.

    ``numbers`` (f,): element number of each face.
    """

    mesh: FaceMesh
    numbers: Integers


def join_faces(zone: Node, points: Floats, sections: list[ListedElements]) -> NumberedFaces:
    """Make the mesh of a zone.

    Raises InvalidInput if faces and cells do not fit together, and as
    :class:`~mesh_motion_server.files.polyhedra.face_mesh.FaceMesh` does.
    """
    polygons = [section for section in sections if section.kind == NGON]
    if not polygons:
        raise zone.refused("NFACE_n cells without NGON_n faces")
    numbers = np.concatenate([part.numbers for part in polygons])
    nodes = np.concatenate([part.entries for part in polygons]) - 1
    sizes = np.concatenate([np.diff(part.starts) for part in polygons])
    order = np.argsort(numbers, kind="stable")
    twice = np.flatnonzero(np.diff(numbers[order]) == 0)
    if len(twice):
        raise zone.refused(f"two of its NGON_n faces are element {int(numbers[order[twice[0]]])}")
    sides = _sides(zone, [s for s in sections if s.kind == NFACE], polygons, numbers[order], order)
    mesh, faces = from_sides(zone.path, points, nodes, sizes, sides)
    return NumberedFaces(mesh, numbers[faces])


def _sides(
    zone: Node, cells: list[ListedElements], polygons: list[ListedElements], numbers: Integers, rows: Integers
) -> Integers:
    """(f, 2) for each face the cell from which its normal points and the cell to which it points; -1 for none.

    ``numbers`` (f,) are the element numbers of the faces, ascending; ``rows`` (f,) are the corresponding faces.
    """
    if not cells:
        if any(part.parents is None for part in polygons):
            raise zone.refused("NGON_n faces without NFACE_n cells, and without ParentElements")
        parents = np.concatenate([part.parents for part in polygons if part.parents is not None])
        known = parents[parents > 0]
        if not len(known):
            raise zone.refused("no face has a parent: the zone has no cells")
        return np.where(parents > 0, parents - int(known.min()), -1)
    entries = np.concatenate([part.entries for part in cells])
    owners = np.repeat(np.arange(sum(len(part.starts) - 1 for part in cells)),
                       np.concatenate([np.diff(part.starts) for part in cells]))  # fmt: skip
    places = np.minimum(np.searchsorted(numbers, np.abs(entries)), len(numbers) - 1)
    wrong = np.flatnonzero(numbers[places] != np.abs(entries))
    if len(wrong):
        raise zone.refused(
            f"cell {int(owners[wrong[0]])} names face {int(entries[wrong[0]])}, which is no NGON_n element"
        )
    faces, side = rows[places], (entries < 0).astype(np.int64)
    taken = np.bincount(2 * faces + side, minlength=2 * len(rows))
    if (taken > 1).any():
        face = int(np.argmax(taken > 1)) // 2
        raise zone.refused(f"face {face} of its NGON_n faces has two cells on the same side")
    sides = np.full((len(rows), 2), -1, dtype=np.int64)
    sides[faces, side] = owners
    return sides
