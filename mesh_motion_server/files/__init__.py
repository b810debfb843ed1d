"""Mesh files: one reader for all formats, and the writers of the results.

================  ======================================================================================
``.npz``          ``points``, ``cells_<type>``, ``patch_<name>`` (:mod:`.npz`); read and written
``.msh``          Gmsh 2.2 and 4.1, ASCII and binary; physical groups become patches (:mod:`.gmsh`)
``.su2``          SU2; markers become patches (:mod:`.su2`)
``.cgns``         an unstructured zone, read with the extra ``mesh``; families become patches (:mod:`.cgns`)
folders, ``.foam``  OpenFOAM's polyMesh, ASCII and binary (:mod:`.openfoam`)
``.vtk``, ``.vtu``  read with the extra ``mesh``; patches from arrays with agreed names (:mod:`.vtk`)
``.vtu``, ``.pvd``  written for ParaView (:mod:`.vtu`)
================  ======================================================================================
"""

from mesh_motion_server.files.mesh_file import MeshFile
from mesh_motion_server.files.npz import write_npz
from mesh_motion_server.files.reader import read_mesh
from mesh_motion_server.files.vtu import VtuSeries, write_vtu
from mesh_motion_server.files.writer import check_target, patch_marks, write_mesh

__all__ = ["MeshFile", "VtuSeries", "check_target", "patch_marks", "read_mesh", "write_mesh", "write_npz", "write_vtu"]
