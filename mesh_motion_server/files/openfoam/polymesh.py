"""OpenFOAM's polyMesh: a case, its ``constant/polyMesh``, or any folder with points, faces, owner, neighbour, boundary.

The reader identifies the cells from their faces (``polyhedra.cells``) and divides polyhedra (``polyhedra.pieces``). One
layer of cells between empty or wedge patches becomes a 2D mesh (:mod:`.plane`). The motion solver for OpenFOAM does the
same. Patches keep their names; empty patches and patches without faces are dropped.
"""

import re
import shutil
from pathlib import Path

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.files.format import Format
from mesh_motion_server.files.mesh_file import MeshFile
from mesh_motion_server.files.openfoam.foam_file import FoamFile, dictionaries
from mesh_motion_server.files.openfoam.plane import plane_axes, project
from mesh_motion_server.files.polyhedra.cells import find_cells
from mesh_motion_server.files.polyhedra.face_mesh import FaceMesh, FacePatch
from mesh_motion_server.files.polyhedra.pieces import divide

#: Roles of types of patches, by the beginning of their names.
_ROLES = {"cyclic": "periodic", "symmetry": "symmetry"}


def read_polymesh(path: Path) -> MeshFile:
    """Read a mesh from a case or a polyMesh folder.

    Raises InvalidInput without such a mesh; for damaged files, decomposed cases, and cells that cannot be divided.
    """
    mesh = read_face_mesh(_polymesh_folder(path))
    axes = plane_axes(mesh)
    wedges = [patch.name for patch in mesh.patches if patch.kind == "wedge"]
    patches = [patch for patch in mesh.patches if patch.count and patch.kind not in ("empty", "wedge")]
    marked = {patch.name: role for patch in patches for kind, role in _ROLES.items() if patch.kind.startswith(kind)}
    if len(axes) == 2:
        plane = project(mesh, axes)
        edges = {patch.name: plane.edges(mesh, patch) for patch in patches}
        if len(plane.axis):
            edges[wedges[0]], marked[wedges[0]] = plane.axis, "symmetry"
        return _mesh(path, plane.points, plane.cells, edges, marked)
    pieces = divide(mesh, find_cells(mesh))
    facets = {patch.name: pieces.facets(mesh, mesh.boundary_faces(patch)) for patch in patches}
    nodes = {name: np.concatenate([part.ravel() for part in parts.values()]) for name, parts in facets.items()}
    return _mesh(path, pieces.points, pieces.cells, nodes, marked)


def _mesh(
    path: Path, points: np.ndarray, cells: dict[str, Integers], nodes: dict[str, Integers], marked: dict[str, str]
) -> MeshFile:
    """The mesh; ``nodes`` has the face nodes of each patch, with repeats."""
    patches = {name: np.unique(of) for name, of in nodes.items()}
    return MeshFile(points, cells, patches, path, marked)


def _polymesh_folder(path: Path) -> Path:
    """The folder with points and faces: that of a case, or the given folder itself.

    Raises InvalidInput if there is none.
    """
    folder = path if path.is_dir() else path.parent
    for candidate in (folder, folder / "polyMesh", folder / "constant" / "polyMesh"):
        if any((candidate / name).is_file() for name in ("faces", "faces.gz")):
            return candidate
    hint = "a case has its mesh in constant/polyMesh (blockMesh makes it)"
    regions = sorted(one.parent.name for one in folder.glob("constant/*/polyMesh") if one.is_dir())
    if regions:
        hint = f"its meshes are those of regions: give one, {folder / 'constant' / regions[0]}"
    if any(one.is_dir() for one in folder.glob("processor*")):  # collated: processors2
        hint = "the case is decomposed: reconstructParMesh -constant merges it"
    raise InvalidInput(f"{path}: neither an OpenFOAM case nor a polyMesh folder: no file 'faces'", hint=hint)


def read_face_mesh(folder: Path) -> FaceMesh:
    """Read points, faces, owner, neighbour and boundary."""
    points = FoamFile.find(folder, "points").vectors()
    starts, nodes = FoamFile.find(folder, "faces").faces()
    n_faces = len(starts) - 1
    owner = FoamFile.find(folder, "owner").labels(at_most=n_faces)
    neighbour = FoamFile.find(folder, "neighbour").labels(at_most=n_faces)
    neighbour = neighbour[: len(neighbour) - int(np.argmax(np.append(neighbour[::-1] != -1, True)))]  # -1: no cell
    patches = _read_boundary(FoamFile.find(folder, "boundary"))
    decomposed = [patch.name for patch in patches if patch.kind.startswith("processor")]
    if decomposed:
        raise InvalidInput(
            f"{folder}: patch {decomposed[0]!r} is of type processor: this is a part of a decomposed mesh",
            hint="reconstructParMesh -constant merges it; at run time adapters/openfoam moves it in parts",
        )
    return FaceMesh(folder, points, starts, nodes, owner, neighbour, patches)


def _read_boundary(file: FoamFile) -> tuple[FacePatch, ...]:
    """The patches."""
    found = []
    for name, entries in dictionaries(file):
        numbers = [entries.get(key, "") for key in ("startFace", "nFaces")]
        for key, number in zip(("startFace", "nFaces"), numbers, strict=True):
            if not (number.isdigit() and len(number) < 19):
                raise file.refused(f"patch {name!r}: {key} is {number!r}, expected a number of faces")
        found.append(FacePatch(name, entries.get("type", "patch"), int(numbers[0]), int(numbers[1])))
    return tuple(found)


def _move(source: Path, target: Path, points: Floats) -> None:
    """Write a polyMesh folder with other points.

    Raises InvalidInput for an axisymmetric mesh, because its nodes are those of a 2D mesh.
    """
    folder = _polymesh_folder(source)
    mesh = read_face_mesh(folder)
    axes, moved = plane_axes(mesh), mesh.points.copy()
    if any(patch.kind == "wedge" for patch in mesh.patches):
        raise InvalidInput(f"{source}: an axisymmetric mesh is not written with moved points", hint="take .vtu")
    moved[:, axes] = points[project(mesh, axes).node_of] if len(axes) == 2 else points[: len(moved)]
    shutil.copytree(folder, target)
    FoamFile.find(target, "points").write_vectors(moved)


_IN_FOLDER = re.compile(rb"(?m)^(faces|faces\.gz|constant|polyMesh|system|processors?\d+)$")
OPENFOAM = Format("an OpenFOAM case", (), _IN_FOLDER, read_polymesh, move=_move, folder=True)
FOAM_FILE = Format("an OpenFOAM case", (".foam",), re.compile(rb"\A\s*\Z"), read_polymesh, move=_move)
