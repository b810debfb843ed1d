"""Writing SU2's native mesh format: a new file, or one whose coordinates alone are replaced."""

from __future__ import annotations

from pathlib import Path

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.files.mesh_file import FloatArray, MeshFile
from mesh_motion_server.files.patch_facets import facets_of_patches
from mesh_motion_server.files.replace import replacing
from mesh_motion_server.files.su2 import key_of
from mesh_motion_server.files.text_rows import integer_rows, real_rows
from mesh_motion_server.numerics.mesh.cells import CELL_TYPES

__all__ = ["check_su2", "move_su2", "write_su2"]

_VERTEX = 1


def check_su2(path: Path, mesh: MeshFile) -> None:
    """Refuse meshes of one dimension, and patches whose names no marker can have: SU2 drops the blanks in them."""
    if mesh.dimension == 1:
        raise InvalidInput(f"{path}: SU2 has no one-dimensional meshes", hint="write .npz, .msh or .vtu")
    for name in mesh.patches:
        if not name or "%" in name or any(character.isspace() for character in name):
            raise InvalidInput(f"{path}: patch {name!r} is no name for a marker of SU2", hint="rename the patch")


def write_su2(path: Path, mesh: MeshFile) -> None:
    """Write a mesh of two or three dimensions; patches become markers."""
    check_su2(path, mesh)
    lines = [f"NDIME= {mesh.dimension}", f"NELEM= {mesh.n_cells}"]
    for name, nodes in mesh.cells.items():
        lines += integer_rows(nodes, [CELL_TYPES[name].vtk])
    lines += [f"NPOIN= {len(mesh.points)}", *real_rows(mesh.points), f"NMARK= {len(mesh.patches)}"]
    for name, patch in facets_of_patches(mesh).items():
        count = len(patch.loose) + sum(len(nodes) for nodes in patch.facets.values())
        lines += [f"MARKER_TAG= {name}", f"MARKER_ELEMS= {count}"]
        for kind, nodes in patch.facets.items():
            lines += integer_rows(nodes, [CELL_TYPES[kind].vtk])
        lines += integer_rows(patch.loose[:, None], [_VERTEX])
    with replacing(path) as file:
        file.write(("\n".join(lines) + "\n").encode())


def move_su2(path: Path, mesh: MeshFile, points: FloatArray) -> None:
    """Write the file again with other coordinates (n, d) of the mesh's zone; every other character stays."""
    lines = mesh.path.read_bytes().decode("utf-8", errors="surrogateescape").splitlines(keepends=True)
    rows = iter(real_rows(points))
    left, zone = 0, mesh.zone
    for number, line in enumerate(lines):
        bare, _, comment = line.partition("%")
        if left and bare.strip():
            words = bare.split()
            rest = words[mesh.dimension :]
            end = line[len(line.rstrip("\r\n")) :] if not comment else ""
            lines[number] = " ".join([next(rows), *rest]) + (f" %{comment}" if comment else end)
            left -= 1
            continue
        key, value = key_of(bare)
        if key == "IZONE":
            zone = value
        elif key == "NPOIN" and zone == mesh.zone:
            left = int(value.split()[0])
    with replacing(path) as file:
        file.write("".join(lines).encode("utf-8", errors="surrogateescape"))
