"""Mesh files: one reader for all formats (:mod:`.formats` is their table), and the writers of the results.

A mesh is written as ``.npz``, as ``.vtu`` for ParaView, or as a copy of its own file with moved nodes (:mod:`.moved`).
"""

from mesh_motion_server.files.mesh_file import MeshFile
from mesh_motion_server.files.npz import write_npz
from mesh_motion_server.files.reader import read_mesh
from mesh_motion_server.files.vtk.vtu import VtuSeries, write_vtu
from mesh_motion_server.files.writer import check_target, patch_marks, write_mesh

__all__ = ["MeshFile", "VtuSeries", "check_target", "patch_marks", "read_mesh", "write_mesh", "write_npz", "write_vtu"]
