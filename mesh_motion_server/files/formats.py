"""The table of formats: a new one is a module of its own and a row here."""

import re

from mesh_motion_server.files.cgns.zone import CGNS
from mesh_motion_server.files.elmer import ELMER
from mesh_motion_server.files.exodus import EXODUS
from mesh_motion_server.files.fluent import FLUENT, FLUENT_HDF5
from mesh_motion_server.files.format import Format
from mesh_motion_server.files.gmsh import GMSH
from mesh_motion_server.files.inp import ABAQUS_INP
from mesh_motion_server.files.mdpa import KRATOS
from mesh_motion_server.files.med import MED
from mesh_motion_server.files.mfem import MFEM
from mesh_motion_server.files.npz import NPZ
from mesh_motion_server.files.openfoam.polymesh import FOAM_FILE, OPENFOAM
from mesh_motion_server.files.su2 import SU2
from mesh_motion_server.files.unv import UNV
from mesh_motion_server.files.vtk import VTK, VTU
from mesh_motion_server.files.xdmf import XDMF

__all__ = ["FORMATS"]

_MESHED = "it has no cells of a volume: mesh the space around it, for example in Gmsh: gmsh -3 -format msh41"
_BY_GMSH = (
    "Gmsh reads it: gmsh FILE -save -format msh41 -o mesh.msh; pip install 'mesh-motion-server[mesh]' brings gmsh"
)
_BY_MFEM = "read are the versions 1.0, 1.2 and 1.3; MFEM refines, or writes for others: Mesh::PrintVTK"
_BY_PARAVIEW = "ParaView reads it: File, Save Data, with the ending .vtu"


def _named(name: str, suffixes: tuple[str, ...], head: bytes, way_in: str) -> Format:
    """A format that is not read, but is known by its beginning."""
    return Format(name, suffixes, re.compile(head), way_in=way_in)


FORMATS: tuple[Format, ...] = (
    NPZ,
    GMSH,
    FLUENT,
    FLUENT_HDF5,
    SU2,
    VTU,
    VTK,
    CGNS,
    MED,
    EXODUS,
    ABAQUS_INP,
    KRATOS,
    ELMER,
    XDMF,
    UNV,
    MFEM,
    OPENFOAM,
    FOAM_FILE,
    _named("a Nastran deck", (".bdf", ".nas"), rb"(?m)^(GRID\*?[ ,]|BEGIN BULK|CEND\b)", _BY_GMSH),
    _named("a Medit mesh", (".mesh", ".meshb"), rb"\A(\s|#.*\n)*MeshVersionFormatted", _BY_GMSH),
    _named("an MFEM mesh of another kind", (".mesh", ".mfem"), rb"\AMFEM ", _BY_MFEM),
    _named("a Netgen mesh", (".vol",), rb"\A\s*mesh3d", "Netgen writes it for Gmsh: File, Export Mesh, Gmsh2 Format"),
    _named("an EnSight case", (".case",), rb"(?i)\A(\s|#.*\n)*FORMAT\s+type:\s*ensight", _BY_PARAVIEW),
    _named("a Tecplot file", (".plt", ".dat", ".tec"), rb"(?i)\A\s*(#!TDV|TITLE\s*=|VARIABLES\s*=)", _BY_PARAVIEW),
    _named("an AVS UCD file", (".inp", ".ucd"), rb"\A(\x07|(\s|#.*\n)*\d+(\s+\d+){4}\s*\n)", _BY_PARAVIEW),
    _named("a surface (STL)", (".stl",), rb"\A\s*solid\b[^$]*\bfacet\s+normal", _MESHED),
    _named("a geometry (STEP)", (".step", ".stp"), rb"\A\s*ISO-10303-21", _MESHED),
    _named("a geometry of Gmsh", (".geo",), rb"(?!)", "mesh it: gmsh -3 FILE -format msh41 (-2 in a plane)"),
)
