"""Writing OpenFOAM's polyMesh: a new one, or one whose points alone are replaced.

A new mesh has its inner faces in upper triangular order and the boundary patch by patch; a 2D mesh becomes one layer of
cells between two planes of a patch of type empty. Moved points go to a copy of the folder, to the folder itself, or to
a time of a case (``case/0.5``, or its ``polyMesh``), where OpenFOAM expects the file ``points`` alone.
"""

from __future__ import annotations

import gzip
import re
import shutil
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.files.foam_file import FoamFile
from mesh_motion_server.files.mesh_file import FloatArray, IntArray, MeshFile
from mesh_motion_server.files.patch_facets import PatchFacets, facets_of_patches
from mesh_motion_server.files.polymesh import polymesh_folder, read_face_mesh
from mesh_motion_server.files.polymesh_place import is_a_time, target_folder
from mesh_motion_server.files.polymesh_plane import plane_axes, project
from mesh_motion_server.files.replace import replacing
from mesh_motion_server.files.text_rows import real_rows
from mesh_motion_server.numerics.mesh.cell_facets import CellFacets
from mesh_motion_server.numerics.mesh.cells import CellTable
from mesh_motion_server.numerics.mesh.extrusion import extruded_cells, extruded_points
from mesh_motion_server.numerics.mesh.facet_matching import padded

__all__ = ["check_move_polymesh", "check_polymesh", "move_polymesh", "write_polymesh"]

_HEAD = """FoamFile
{{
    version     2.0;
    format      ascii;
    class       {kind};
    location    "constant/polyMesh";
    object      {name};
}}

"""
_REST, _EMPTY = "defaultFaces", "frontAndBack"
_WORD = re.compile(r"[^\s\"'/;{}()]+")


def write_polymesh(path: Path, mesh: MeshFile) -> None:
    """Write a mesh into a case or a polyMesh folder that has none yet.

    Raises
    ------
    InvalidInput
        If there is a mesh, for meshes of one dimension, and for patches that are not made of faces of the boundary.
    """
    layout = _laid_out(path, mesh)
    folder = target_folder(path)
    folder.mkdir(parents=True, exist_ok=True)
    _write(folder / "points", "vectorField", [f"({row})" for row in real_rows(layout.points)])
    _write(folder / "owner", "labelList", map(str, layout.owner.tolist()))
    _write(folder / "neighbour", "labelList", map(str, layout.neighbour.tolist()))
    _write(folder / "boundary", "polyBoundaryMesh", _boundary(layout.counts, len(layout.neighbour)))
    _write(folder / "faces", "faceList", _face_rows(layout.faces))  # last: with it there is a mesh


def check_polymesh(path: Path, mesh: MeshFile) -> None:
    """Refuse what :func:`write_polymesh` does."""
    _laid_out(path, mesh)


@dataclass(frozen=True, eq=False)
class _Layout:
    """What goes into the files: points (p, 3), faces (f, 4), owner (f,), neighbour (i,), {patch: faces}."""

    points: FloatArray
    faces: NDArray[np.integer[Any]]
    owner: NDArray[np.integer[Any]]
    neighbour: NDArray[np.integer[Any]]
    counts: dict[str, int]


def _laid_out(path: Path, mesh: MeshFile) -> _Layout:
    """The mesh by its faces, if there is room for it and all patches are made of them."""
    _check_free(target_folder(path))
    if mesh.dimension == 1:
        raise InvalidInput(f"{path}: OpenFOAM's meshes have no less than two dimensions")
    patches = {name: _faces(path, name, patch) for name, patch in facets_of_patches(mesh).items()}
    points, cells, empty = mesh.points, mesh.cell_table, np.empty((0, 4), dtype=np.int64)
    if mesh.dimension == 2:
        n = len(points)
        empty, points, cells = _planes(cells, n), extruded_points(points), extruded_cells(cells, n)
        patches = {name: np.column_stack([f[:, :2], f[:, 1::-1] + n]) for name, f in patches.items()}
    facets = CellFacets.of(cells)
    order, counts = _by_patch(path, facets, patches | ({_EMPTY: empty} if len(empty) else {}))
    first = len(facets.neighbour)
    chosen = np.concatenate([np.arange(first), first + order])
    return _Layout(points, facets.nodes[chosen], facets.owner[chosen], facets.neighbour, counts)


def _check_free(folder: Path) -> None:
    """Refuse a folder with a mesh in it."""
    if any((folder / name).exists() for name in ("faces", "faces.gz")):
        raise InvalidInput(f"{folder}: there is a mesh already", hint="remove it, or name another case")


def _faces(path: Path, name: str, patch: PatchFacets) -> IntArray:
    """(f, 4) the facets of a patch, which must be all of it."""
    if len(patch.loose):
        raise InvalidInput(
            f"{path}: node {int(patch.loose[0])} of patch {name!r} is on none of its faces; patches of OpenFOAM are "
            "made of faces",
            hint="leave the patch out, or write .msh, .su2, .cgns or .vtu",
        )
    if _WORD.fullmatch(name) is None:
        raise InvalidInput(f"{path}: patch {name!r} is no word of OpenFOAM", hint="rename the patch")
    parts = [padded(nodes) for nodes in patch.facets.values()]
    return np.concatenate([np.empty((0, 4), dtype=np.int64), *parts])


def _planes(cells: CellTable, count: int) -> IntArray:
    """The faces of one layer of cells on both of its planes."""
    return np.concatenate([padded(block.nodes + shift) for block in cells for shift in (0, count)])


def _by_patch(path: Path, facets: CellFacets, patches: dict[str, IntArray]) -> tuple[IntArray, dict[str, int]]:
    """The order of the boundary's faces patch by patch, and how many each has."""
    names = list(patches)
    boundary = np.sort(facets.boundary, axis=1)
    listed = np.concatenate([np.sort(patches[name], axis=1) for name in names] or [boundary[:0]])
    of = np.repeat(np.arange(len(names)), [len(patches[name]) for name in names])
    keys = np.concatenate([boundary, listed])
    _, inverse = np.unique(keys, axis=0, return_inverse=True)
    inverse = inverse.ravel()
    place = np.full(int(inverse.max(initial=-1)) + 1, -1, dtype=np.int64)
    place[inverse[: len(boundary)]] = np.arange(len(boundary))
    rows = place[inverse[len(boundary) :]]
    patch_of = np.full(len(boundary), len(names), dtype=np.int64)
    for number, name in enumerate(names):
        mine = rows[of == number]
        if (mine < 0).any():
            nodes = listed[of == number][mine < 0][0]
            raise InvalidInput(
                f"{path}: the face with the nodes {', '.join(str(v) for v in nodes if v >= 0)} of patch {name!r} is "
                "not on the boundary",
                hint="patches inside a mesh cannot be written for OpenFOAM",
            )
        if (patch_of[mine] < len(names)).any():
            other = names[int(patch_of[mine][patch_of[mine] < len(names)][0])]
            raise InvalidInput(
                f"{path}: patches {other!r} and {name!r} share a face; a face of OpenFOAM is in one patch",
                hint="leave one of them out",
            )
        patch_of[mine] = number
    counts = {name: int((patch_of == number).sum()) for number, name in enumerate([*names, _REST])}
    return np.argsort(patch_of, kind="stable"), {name: n for name, n in counts.items() if n or name != _REST}


def _boundary(counts: dict[str, int], first: int) -> list[str]:
    """The entries of ``boundary``."""
    rows = []
    for name, count in counts.items():
        kind = "empty" if name == _EMPTY else "patch"
        rows.append(f"{name}\n{{\n    type        {kind};\n    nFaces      {count};\n    startFace   {first};\n}}")
        first += count
    return rows


def _face_rows(faces: NDArray[np.integer[Any]]) -> Iterable[str]:
    """``3(0 1 2)``, ``4(0 1 2 3)``."""
    sizes = (faces >= 0).sum(axis=1).tolist()
    return (f"{n}({' '.join(map(str, row[:n]))})" for n, row in zip(sizes, faces.tolist(), strict=True))


def _write(path: Path, kind: str, rows: Iterable[str]) -> None:
    """One file with a list."""
    lines = list(rows)
    text = _HEAD.format(kind=kind, name=path.name) + "\n".join([str(len(lines)), "(", *lines, ")", ""])
    with replacing(path) as file:
        file.write(text.encode())


def move_polymesh(path: Path, mesh: MeshFile, points: FloatArray) -> None:
    """Replace the points: of the same mesh, of a copy of it, or for a time of its case.

    Raises
    ------
    InvalidInput
        If there is another mesh at the target.
    """
    folder, place = _places(path, mesh)
    old = FoamFile.find(folder, "points")
    data = old.with_vectors(_all_points(folder, old, mesh, points))
    if is_a_time(path):
        place.mkdir(parents=True, exist_ok=True)
    elif place.resolve() != folder.resolve():
        shutil.copytree(folder, place, dirs_exist_ok=True)
    with replacing(place / old.path.name) as file:
        file.write(gzip.compress(data, mtime=0) if old.path.suffix == ".gz" else data)


def _places(path: Path, mesh: MeshFile) -> tuple[Path, Path]:
    """The folder of the mesh, and the one for its points, which is the same or has no mesh."""
    folder, place = polymesh_folder(mesh.path), target_folder(path)
    if place.resolve() != folder.resolve():
        _check_free(place)
    return folder, place


def check_move_polymesh(path: Path, mesh: MeshFile) -> None:
    """Refuse what :func:`move_polymesh` does."""
    _places(path, mesh)


def _all_points(folder: Path, old: FoamFile, mesh: MeshFile, points: FloatArray) -> FloatArray:
    """(p, 3) the points of the file from the nodes of the mesh: middles and centres are no points, planes have two."""
    moved = old.vectors()
    if mesh.dimension == 3:
        return points[: len(moved)]
    faces = read_face_mesh(folder)
    axes = plane_axes(faces)
    moved[:, list(axes)] = points[project(faces, axes).node_of]
    return moved
