"""The table of formats: a new format is a module and a row here."""

import re

from mesh_motion_server.files.cgns.zone import CGNS
from mesh_motion_server.files.format import Format
from mesh_motion_server.files.gmsh.mesh import GMSH
from mesh_motion_server.files.npz import NPZ
from mesh_motion_server.files.openfoam.polymesh import FOAM_FILE, OPENFOAM
from mesh_motion_server.files.programs.elmer import ELMER
from mesh_motion_server.files.programs.ensight import ENSIGHT, ENSIGHT_GEOMETRY
from mesh_motion_server.files.programs.exodus import EXODUS
from mesh_motion_server.files.programs.fluent import FLUENT, FLUENT_HDF5
from mesh_motion_server.files.programs.inp import ABAQUS_INP
from mesh_motion_server.files.programs.mdpa import KRATOS
from mesh_motion_server.files.programs.med import MED
from mesh_motion_server.files.programs.medit import MEDIT
from mesh_motion_server.files.programs.mfem import MFEM
from mesh_motion_server.files.programs.nastran import NASTRAN
from mesh_motion_server.files.programs.netgen import NETGEN
from mesh_motion_server.files.programs.plot3d import PLOT3D
from mesh_motion_server.files.programs.su2 import SU2
from mesh_motion_server.files.programs.ucd import UCD
from mesh_motion_server.files.programs.ugrid import UGRID
from mesh_motion_server.files.programs.unv import UNV
from mesh_motion_server.files.vtk.reading import PVTU, VTK, VTKHDF, VTU
from mesh_motion_server.files.xdmf import XDMF

_MESHED = "it has no cells of a volume: mesh the space around it, for example in Gmsh: gmsh -3 -format msh41"
_BY_GMSH = (
    "Gmsh reads it: gmsh FILE -save -format msh41 -o mesh.msh; pip install 'mesh-motion-server[mesh]' installs gmsh"
)
_IN_NETGEN = "mesh it in Netgen: File, Save Mesh, with the ending .vol"
_BY_MFEM = "versions 1.0, 1.2 and 1.3 are read; Mesh::PrintVTK of MFEM writes a mesh for other programs"
_BY_PARAVIEW = "ParaView reads it: filter Merge Blocks, then File, Save Data, with the ending .vtu"
_BY_MESHIO = "meshio reads it: pip install meshio, meshio convert FILE mesh.vtu"
_BY_ITS_PROGRAM = "its program exports formats that are read, for example CGNS or Fluent's .msh"


def _named(name: str, suffixes: tuple[str, ...], head: bytes, way_in: str) -> Format:
    """A format that is not read, but recognised by its beginning."""
    return Format(name, suffixes, re.compile(head), way_in=way_in)


FORMATS: tuple[Format, ...] = (
    _named("an empty file", (), rb"\A\Z", "was its program or its copy interrupted?"),
    _named("a packed file", (), rb"\A(\x1f\x8b|BZh\d|\xfd7zXZ|\x28\xb5\x2f\xfd|7z\xbc\xaf)", "unpack it before"),
    _named("a file in HDF5", (), rb"\A\x89HDF", "give it the ending of its program: .cgns, .med, .exo, …"),
    _named("a pointer of Git LFS", (), rb"\Aversion https://git-lfs", "the file itself is missing: git lfs pull"),
    _named(
        "a page of the web", (), rb"(?i)\A\s*<(!doctype\s+)?html\b", "the download is not a mesh: open it in an editor"
    ),
    _named("a text with a byte order mark", (), rb"\A(\xef\xbb\xbf(?!\s*<)|\xff\xfe|\xfe\xff)", "save it without"),
    NPZ,
    _named("a Gmsh mesh of version 1", (), rb"\A\s*\$NOD\b", _BY_GMSH),
    GMSH,
    FLUENT,
    FLUENT_HDF5,
    SU2,
    PVTU,
    VTU,
    VTK,
    VTKHDF,
    _named("a MOAB mesh", (".h5m",), rb"\A\x89HDF", "MOAB converts it: mbconvert FILE mesh.vtk"),
    CGNS,
    MED,
    _named(
        "a netCDF file of 64-bit numbers (CDF-5)", (), rb"\ACDF\x05", "nccopy of netCDF's tools: nccopy -k nc4 FILE NEW"
    ),
    EXODUS,
    _named("an LS-DYNA deck", (".k", ".key", ".dyn", ".inp"), rb"(?im)^\*(KEYWORD\b|ELEMENT_)", _BY_ITS_PROGRAM),
    ABAQUS_INP,
    KRATOS,
    ELMER,
    XDMF,
    UNV,
    MFEM,
    MEDIT,
    ENSIGHT,
    ENSIGHT_GEOMETRY,
    NETGEN,
    UGRID,
    PLOT3D,
    OPENFOAM,
    FOAM_FILE,
    NASTRAN,
    _named("an MFEM mesh of another kind", (".mesh", ".mfem"), rb"\AMFEM ", _BY_MFEM),
    _named(
        "a FreeFEM mesh",
        (".msh",),
        rb"\A[ \t]*\d+([ \t]+\d+){2}[ \t\r]*\n([ \t]*[-+.\deE]+){2}[ \t]+\d+[ \t\r]*\n",
        'FreeFEM writes it with its labels: load "iovtk", savevtk("mesh.vtu", Th)',
    ),
    _named("a Tecplot file", (".plt", ".tec"), rb"(?i)\A(#!TDV|(\s|#.*\n)*(TITLE|VARIABLES)\s*=)", _BY_PARAVIEW),
    UCD,
    _named("a binary AVS UCD file", (".inp", ".ucd"), rb"\A\x07", _BY_PARAVIEW),
    _named("an Ansys deck", (".cdb",), rb"(?im)^(/PREP7|NBLOCK,|/COM,\s*ANSYS)", _BY_ITS_PROGRAM),
    _named("a STAR-CCM+ mesh", (".ccm", ".ccmg"), rb"ADF", _BY_ITS_PROGRAM),
    _named("a STAR-CD mesh", (".vrt", ".cel", ".bnd"), rb"\APROSTAR_", "star4ToFoam of OpenFOAM makes a case of it"),
    _named("a Gambit mesh", (".neu",), rb"\A\s*CONTROL INFO", _BY_ITS_PROGRAM),
    _named("a COMSOL mesh", (".mphtxt", ".mphbin"), rb"\A# .* COMSOL", "COMSOL exports Nastran, which is read"),
    _named(
        "a GiD mesh",
        (".msh",),
        rb"\A((?s:\x03\0{3}[\x01-\x40]\0{3}.{12}\x01\0{11})|\0{8}.\0{3}GID_MESHSET|(?i:(#.*\n)*MESH\b.*\bElemType\b))",
        "GiD's problem types for Kratos write .mdpa, which is read",
    ),
    _named(
        "a libMesh mesh",
        (".xda", ".xdr"),
        rb"\A(\0\0\0.)?(libMesh-|LIBM |DEAL )",
        "libMesh converts it: meshtool -i FILE -o mesh.e",
    ),
    _named("a DUNE grid", (".dgf",), rb"\ADGF\b", "Dune::GmshWriter writes Gmsh's .msh, which is read"),
    _named(
        "a Radioss deck",
        (".rad",),
        rb"(?m)^(#RADIOSS STARTER|/BEGIN\b)",
        "HyperMesh exports it for OptiStruct as .fem, which is read",
    ),
    _named(
        "a mesh of code_aster",
        (".mail",),
        rb"(?m)^[ \t]*COOR_[23]D\b",
        "code_aster writes MED, which is read: IMPR_RESU(FORMAT='MED', RESU=_F(MAILLAGE=…))",
    ),
    _named(
        "a list of a series (ParaView)", (".series",), rb'"file-series-version"', "give one of the files that it names"
    ),
    _named("a FLAC3D grid", (".f3grid",), rb"\A\* FLAC3D", _BY_MESHIO),
    _named("a PERMAS model", (".dato",), rb"(?m)^\$ENTER COMPONENT", _BY_MESHIO),
    _named("a Nektar++ mesh", (".xml",), rb"<NEKTAR\b", "FieldConvert FILE mesh.vtu"),
    _named("an FEBio model", (".feb",), rb"<febio_spec\b", "FEBio Studio exports .vtk, which is read"),
    _named("a mesh of DOLFIN", (".xml",), rb"<dolfin\b", _BY_MESHIO),
    _named("a mesh of TetGen", (".node", ".ele", ".poly", ".smesh"), rb"(?!)", "tetgen -g writes Medit's .mesh"),
    _named("a surface (STL)", (".stl",), rb"\A\s*solid\b[^$]*\bfacet\s+normal", _MESHED),
    _named("a surface (PLY)", (".ply",), rb"\Aply\r?\n", _MESHED),
    _named("a surface (OFF)", (".off",), rb"\AOFF\s", _MESHED),
    _named("a surface (OBJ)", (".obj",), rb"(?m)\A(#.*\n|\s|\w+ .*\n)*v( +[-+.\deE]+){3}", _MESHED),
    _named("a geometry (STEP)", (".step", ".stp"), rb"\A\s*ISO-10303-21", _MESHED),
    _named("a geometry (IGES)", (".iges", ".igs"), rb"\A.{72}S\s*1\s", _MESHED),
    _named("a geometry (BREP)", (".brep", ".brp"), rb"\A\s*(DBRep_DrawableShape|CASCADE Topology)", _MESHED),
    _named("a geometry of Netgen", (".in2d", ".geo"), rb"\A(\s|#.*\n)*(splinecurves|algebraic3d)", _IN_NETGEN),
    _named("a file of an Elmer folder", (".header", ".nodes", ".elements", ".boundary"), rb"(?!)", "give its folder"),
    _named(
        "a neutral mesh of Netgen",
        (".mesh",),
        rb"\A\d+[ \t\r]*\n([ \t]+[-+.\deE]+){3}[ \t\r]*\n",
        "Netgen: File, Save Mesh, with the ending .vol",
    ),
    _named("an input of ElmerGrid", (".grd",), rb"(?m)^(Version = \d|Coordinate System = )", "ElmerGrid 1 2 FILE"),
    _named("a file of OpenFOAM", (), rb"(?m)^FoamFile\b", "give the folder of its case"),
    _named(
        "a geometry of Gmsh",
        (".geo",),
        rb"(?m)^(SetFactory ?\(|(Include|Merge) \"|[A-Z][\w ]+ ?\(.*\) ?= ?\{|Mesh\.)",
        "mesh it: gmsh -3 FILE -format msh41 (-2 in a plane)",
    ),
)
