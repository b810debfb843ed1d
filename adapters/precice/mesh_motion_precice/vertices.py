"""preCICE's meshes: the wet surfaces that displacements are read on, the volume that they are written to."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from mesh_motion_client import InvalidInput, Mesh
from numpy.typing import NDArray

from mesh_motion_precice.api import Coupling
from mesh_motion_precice.configuration import Surface, Volume

__all__ = ["VolumeVertices", "WetVertices", "nodes_at"]

#: Vertices count as a node's within this share of the mesh's extent: coordinates pass through files of 12 digits.
_MATCH = 1e-9
#: The region asked for of a received mesh is larger than the mesh by this share of its extent.
_MARGIN = 1e-3


@dataclass(frozen=True)
class WetVertices:
    """The nodes of one moving patch as vertices of a preCICE mesh.

    Attributes
    ----------
    surface : Surface
    nodes : (p,) int64 array
        Nodes of the mesh file.
    ids : (p,) int32 array
        preCICE's numbers of them.
    """

    surface: Surface
    nodes: NDArray[np.int64]
    ids: NDArray[np.int32]

    @classmethod
    def provide(cls, coupling: Coupling, surface: Surface, mesh: Mesh) -> WetVertices:
        """Tell preCICE where the patch's nodes are in the reference mesh."""
        _check_dimension(coupling, surface.mesh, mesh)
        nodes = mesh.patches[surface.patch].nodes
        return cls(surface, nodes, coupling.set_mesh_vertices(surface.mesh, mesh.points[nodes]))

    def read(self, coupling: Coupling, relative_time: float) -> NDArray[np.float64]:
        """(p, d) displacements at that time after the present one, mesh length unit."""
        return coupling.read_data(self.surface.mesh, self.surface.data, self.ids, relative_time)


@dataclass(frozen=True)
class VolumeVertices:
    """The nodes whose displacement is written.

    Attributes
    ----------
    volume : Volume
    nodes : (m,) int64 array
        Nodes of the mesh file.
    ids : (m,) int32 array
        preCICE's numbers of them.
    """

    volume: Volume
    nodes: NDArray[np.int64]
    ids: NDArray[np.int32]

    @classmethod
    def prepare(cls, coupling: Coupling, volume: Volume, mesh: Mesh) -> VolumeVertices:
        """Before ``initialize``: provide a vertex a node, or say which part of the received mesh is wanted (all)."""
        _check_dimension(coupling, volume.mesh, mesh)
        if not volume.received:
            nodes = np.arange(len(mesh.points), dtype=np.int64)
            return cls(volume, nodes, coupling.set_mesh_vertices(volume.mesh, mesh.points))
        lowest, highest = mesh.points.min(axis=0), mesh.points.max(axis=0)
        margin = _MARGIN * float(np.max(highest - lowest))
        coupling.set_mesh_access_region(volume.mesh, np.stack([lowest - margin, highest + margin], axis=1).ravel())
        return cls(volume, np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int32))

    def settled(self, coupling: Coupling, mesh: Mesh) -> VolumeVertices:
        """After ``initialize``: which node each vertex of a received mesh is.

        Raises
        ------
        InvalidInput
            The solver's mesh is empty, or a vertex of it lies on no node of the mesh file.
        """
        if not self.volume.received:
            return self
        ids, places = coupling.get_mesh_vertex_ids_and_coordinates(self.volume.mesh)
        if not len(ids):
            raise InvalidInput(f"the preCICE mesh {self.volume.mesh!r} has no vertex near the mesh file's nodes")
        return VolumeVertices(self.volume, nodes_at(places, mesh.points, f"mesh {self.volume.mesh!r}"), ids)

    def write(self, coupling: Coupling, displacement: NDArray[np.float64]) -> None:
        """Write the displacements (n, d) of the mesh file's nodes where there is a vertex for them."""
        coupling.write_data(self.volume.mesh, self.volume.data, self.ids, displacement[self.nodes])


def nodes_at(places: NDArray[np.float64], points: NDArray[np.float64], what: str) -> NDArray[np.int64]:
    """The node at each place.

    Parameters
    ----------
    places : (m, d) array
    points : (n, d) array
        Nodes, no two of them nearer than 4e-9 of their extent.
    what : str
        For messages: whose places they are.

    Returns
    -------
    (m,) int64 array

    Raises
    ------
    InvalidInput
        No node lies within 1e-9 of the extent of a place, or two nodes cannot be told apart.

    Notes
    -----
    Nodes are sorted into boxes of four tolerances; a place has its node in its box or in one that it nearly touches.
    """
    origin, extent = points.min(axis=0), float(np.max(np.ptp(points, axis=0))) or 1.0
    tolerance = _MATCH * extent

    def boxes(shifted: NDArray[np.float64]) -> NDArray[np.void]:
        """One comparable key (rows,) a row."""
        whole = np.floor((shifted - origin) / (4.0 * tolerance)).astype(np.int64)
        return np.ascontiguousarray(whole).view([("", np.int64)] * whole.shape[1]).ravel()

    keys, first = np.unique(boxes(points), return_index=True)
    if len(keys) < len(points):
        raise InvalidInput("two nodes of the mesh file lie at one place: the solver's vertices cannot be told apart")
    found = np.full(len(places), -1, dtype=np.int64)
    for signs in product((-tolerance, tolerance), repeat=points.shape[1]):
        wanted = boxes(places + np.array(signs))
        at = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
        node = first[at]
        near = (keys[at] == wanted) & (np.abs(points[node] - places) <= tolerance).all(axis=1)
        found[near] = node[near]
    if (found < 0).any():
        row = int(np.argmin(found))
        raise InvalidInput(
            f"vertex {row} of {what} at {places[row].tolist()} lies on no node of the mesh file",
            hint="the solver's mesh and the mesh file must be the same undeformed mesh, in the same unit",
            details={"row": row},
        )
    return found


def _check_dimension(coupling: Coupling, name: str, mesh: Mesh) -> None:
    """preCICE's mesh has the mesh file's dimension."""
    dimensions = coupling.get_mesh_dimensions(name)
    if dimensions != mesh.dimension:
        raise InvalidInput(
            f"the preCICE mesh {name!r} has {dimensions} dimensions, the mesh file {mesh.dimension}",
            hint=f'<mesh name="{name}" dimensions="{mesh.dimension}"> in precice-config.xml',
        )
