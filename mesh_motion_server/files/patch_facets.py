"""The facets of patches, as files are written."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mesh_motion_server.files.mesh_file import IntArray, MeshFile
from mesh_motion_server.numerics.mesh.cell_facets import CellFacets

__all__ = ["FACET_TYPES", "PatchFacets", "facets_of_patches"]

#: Types of facets by how many nodes they have.
FACET_TYPES = {2: "line", 3: "triangle", 4: "quad"}


@dataclass(frozen=True, eq=False)
class PatchFacets:
    """A patch: {type: (f, k)} its facets, and (p,) its nodes that are on none of them."""

    facets: dict[str, IntArray]
    loose: IntArray


def facets_of_patches(mesh: MeshFile) -> dict[str, PatchFacets]:
    """The facets of each patch: those that the file says; otherwise the boundary's facets whose nodes it has.

    A facet of the boundary whose nodes several patches have goes to the one with the fewest nodes: an edge across a
    channel has its nodes on both walls too.
    """
    derived = [name for name in mesh.patches if name not in mesh.facets]
    found = dict(mesh.facets)
    if derived and mesh.dimension > 1:
        found |= _derived(mesh, sorted(derived, key=lambda name: len(mesh.patches[name])))
    return {name: _with_loose(found.get(name, {}), nodes) for name, nodes in mesh.patches.items()}


def _derived(mesh: MeshFile, names: list[str]) -> dict[str, dict[str, IntArray]]:
    """Facets of the patches, each facet in the first one that has its nodes."""
    boundary = CellFacets.of(mesh.cell_table).boundary
    free = np.ones(len(boundary), dtype=bool)
    found = {}
    for name in names:
        on = np.zeros(len(mesh.points) + 1, dtype=bool)
        on[mesh.patches[name]] = on[-1] = True  # -1 is no node: it is on every patch
        mine = free & on[boundary].all(axis=1)
        free &= ~mine
        sizes = (boundary[mine] >= 0).sum(axis=1)
        found[name] = {
            kind: boundary[mine][sizes == size, :size] for size, kind in FACET_TYPES.items() if (sizes == size).any()
        }
    return found


def _with_loose(facets: dict[str, IntArray], nodes: IntArray) -> PatchFacets:
    """The facets, and what they leave of the nodes."""
    covered = np.concatenate([np.empty(0, dtype=np.int64), *(of.ravel() for of in facets.values())])
    return PatchFacets(facets, np.setdiff1d(nodes, covered))
