"""preCICE's meshes: the wet surfaces, where displacements are read, and the volume, where displacements are written."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from mesh_motion_client import InvalidInput, Mesh, Unavailable
from numpy.typing import NDArray

from mesh_motion_precice.api import Coupling
from mesh_motion_precice.configuration import Surface, Volume
from mesh_motion_precice.connectivity import cell_simplices, patch_facets

__all__ = ["VolumeVertices", "WetVertices", "nodes_at"]

#: A vertex is at a node within this share of the distance to the next node: files give coordinates with few digits.
_MATCH = 1e-3
#: The region asked for of a received mesh is larger than the mesh by this share of its extent.
_MARGIN = 1e-3


@dataclass(frozen=True)
class WetVertices:
    """The nodes of one moving patch as vertices of a preCICE mesh.

    Attributes
    ----------
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
        """Give preCICE the reference coordinates of the patch's nodes."""
        _check_dimension(coupling, surface.mesh, surface.data, mesh)
        nodes = mesh.patches[surface.patch].nodes
        ids = coupling.set_mesh_vertices(surface.mesh, mesh.points[nodes])
        if coupling.requires_mesh_connectivity_for(surface.mesh):
            connect = coupling.set_mesh_edges if mesh.dimension == 2 else coupling.set_mesh_triangles
            connect(surface.mesh, ids[patch_facets(mesh, nodes)])
        return cls(surface, nodes, ids)

    def read(self, coupling: Coupling, relative_time: float) -> NDArray[np.float64]:
        """(p, d) displacements at ``relative_time`` after the present time, mesh length unit."""
        return coupling.read_data(self.surface.mesh, self.surface.data, self.ids, relative_time)


@dataclass(frozen=True)
class VolumeVertices:
    """The nodes whose displacement is written.

    Attributes
    ----------
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
        """Provide one vertex for each node, or request the whole received mesh; called before ``initialize``."""
        for data in filter(None, (volume.data, volume.velocity)):
            _check_dimension(coupling, volume.mesh, data, mesh)
        vertices = cls._requested(coupling, volume, mesh) if volume.received else cls._provided(coupling, volume, mesh)
        empty = cls(volume, vertices.nodes[:0], vertices.ids[:0])
        empty.write(coupling, mesh.points, mesh.points)  # nothing; preCICE says now whether the data may be written
        return vertices

    @classmethod
    def _provided(cls, coupling: Coupling, volume: Volume, mesh: Mesh) -> VolumeVertices:
        """Provide one vertex for each node, and the cells if a mapping uses them."""
        ids = coupling.set_mesh_vertices(volume.mesh, mesh.points)
        if coupling.requires_mesh_connectivity_for(volume.mesh):
            simplices = ids[cell_simplices(mesh)]
            if mesh.dimension == 3:
                coupling.set_mesh_tetrahedra(volume.mesh, simplices)
            else:  # one by one: set_mesh_triangles of pyprecice 3.0 to 3.4 takes none in two dimensions
                for triangle in simplices:
                    coupling.set_mesh_triangle(volume.mesh, *triangle)
        return cls(volume, np.arange(len(mesh.points), dtype=np.int64), ids)

    @classmethod
    def _requested(cls, coupling: Coupling, volume: Volume, mesh: Mesh) -> VolumeVertices:
        """Request a mesh to receive, in a box around the mesh file's mesh; it has no vertices yet."""
        lowest, highest = mesh.points.min(axis=0), mesh.points.max(axis=0)
        margin = _MARGIN * float(np.max(highest - lowest))
        coupling.set_mesh_access_region(volume.mesh, np.stack([lowest - margin, highest + margin], axis=1).ravel())
        return cls(volume, np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int32))

    def settled(self, coupling: Coupling, mesh: Mesh) -> VolumeVertices:
        """Find the node at each vertex of a received mesh; called after ``initialize``.

        Raises
        ------
        InvalidInput
            The solver's mesh is empty, or one of its vertices lies on no node of the mesh file.
        """
        if not self.volume.received:
            return self
        ids, places = coupling.get_mesh_vertex_ids_and_coordinates(self.volume.mesh)
        if not len(ids):
            raise InvalidInput(f"the preCICE mesh {self.volume.mesh!r} has no vertex near the mesh file's nodes")
        return VolumeVertices(self.volume, nodes_at(places, mesh.points, f"mesh {self.volume.mesh!r}"), ids)

    def write(
        self, coupling: Coupling, displacement: NDArray[np.float64], velocity: NDArray[np.float64] | None
    ) -> None:
        """Write the displacement (n, d) of the mesh file's nodes that have a vertex, and their velocity if wanted."""
        coupling.write_data(self.volume.mesh, self.volume.data, self.ids, displacement[self.nodes])
        if self.volume.velocity and velocity is not None:
            coupling.write_data(self.volume.mesh, self.volume.velocity, self.ids, velocity[self.nodes])


def nodes_at(places: NDArray[np.float64], points: NDArray[np.float64], what: str) -> NDArray[np.int64]:
    """The node at each place.

    Parameters
    ----------
    places : (m, d) array
    points : (n, d) array
        Nodes, n > 1.
    what : str
        For messages: the owner of the places.

    Returns
    -------
    (m,) int64 array

    Raises
    ------
    InvalidInput
        A place is farther from its nearest node than a thousandth of the distance to the next one, or two nodes are
        there.
    """
    node: NDArray[np.int64]
    distance, node = _search_tree(points).query(places, k=2, workers=-1)
    lost = ~(distance[:, 0] < _MATCH * distance[:, 1])
    if lost.any():
        row = int(np.argmax(lost))
        vertex = f"vertex {row} of {what} at {places[row].tolist()}"
        if (points[node[row, 0]] == points[node[row, 1]]).all():
            raise InvalidInput(f"{vertex}: the nodes {node[row].tolist()} of the mesh file are both there")
        raise InvalidInput(
            f"{vertex} lies on no node of the mesh file; the nearest is {distance[row, 0]:.3g} away",
            hint="the solver's mesh and the mesh file must be the same undeformed mesh, in the same unit",
            details={"row": row},
        )
    return node[:, 0]


def _search_tree(points: NDArray[np.float64]) -> Any:
    """A k-d tree of the nodes; scipy is imported here, since only received meshes need it."""
    try:
        from scipy.spatial import KDTree  # noqa: PLC0415
    except ImportError as error:
        raise Unavailable(
            f"write.received needs scipy: {error}", hint="pip install 'mesh-motion-server[server]'"
        ) from None
    return KDTree(points)


def _check_dimension(coupling: Coupling, name: str, data: str, mesh: Mesh) -> None:
    """Check that preCICE's mesh and its data have the mesh file's dimension."""
    dimensions = coupling.get_mesh_dimensions(name)
    if dimensions != mesh.dimension:
        raise InvalidInput(
            f"the preCICE mesh {name!r} has {dimensions} dimensions, the mesh file {mesh.dimension}",
            hint=f'<mesh name="{name}" dimensions="{mesh.dimension}"> in precice-config.xml',
        )
    if coupling.get_data_dimensions(name, data) != mesh.dimension:
        raise InvalidInput(
            f"the data {data!r} is not a vector", hint=f'<data:vector name="{data}" /> in precice-config.xml'
        )
