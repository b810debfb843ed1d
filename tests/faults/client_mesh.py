"""Meshes of triangles for the rows, as the Python client accepts them."""

import numpy as np
from mesh_motion_client import Mesh, Patch

from mesh_motion_server.session.partitions.meshes import PartitionMesh


def client_mesh(mesh: PartitionMesh) -> Mesh:
    """The same mesh for the client, in one piece and without global ids."""
    patches = {name: Patch(patch.role, patch.nodes) for name, patch in mesh.patches.items()}
    return Mesh(mesh.points, {"triangle": np.asarray(mesh.cells["triangle"])}, patches)
