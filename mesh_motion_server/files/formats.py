"""The table of formats: a new one is a module of its own and a row here."""

import re

from mesh_motion_server.files.cgns.zone import CGNS
from mesh_motion_server.files.exodus import EXODUS
from mesh_motion_server.files.fluent import FLUENT, FLUENT_HDF5
from mesh_motion_server.files.format import Format
from mesh_motion_server.files.gmsh import GMSH
from mesh_motion_server.files.med import MED
from mesh_motion_server.files.npz import NPZ
from mesh_motion_server.files.openfoam.polymesh import FOAM_FILE, OPENFOAM
from mesh_motion_server.files.su2 import SU2
from mesh_motion_server.files.vtk import VTK, VTU

__all__ = ["FORMATS"]

_MESHED = "it has no cells of a volume: mesh the space around it (Gmsh: gmsh -3 -format msh41)"

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
    OPENFOAM,
    FOAM_FILE,
    # known by their beginning, and not read
    Format("a surface (STL)", (".stl",), re.compile(rb"\A\s*solid\b[^$]*\bfacet\s+normal"), way_in=_MESHED),
    Format("a geometry (STEP)", (".step", ".stp"), re.compile(rb"\A\s*ISO-10303-21"), way_in=_MESHED),
)
