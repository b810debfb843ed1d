"""OpenFOAM's binary files that a mesh-motion case needs: headers, lists, faces, point fields."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.openfoam.polymesh import PolyMesh

__all__ = ["read_points", "write_dictionary", "write_point_field", "write_polymesh"]

Floats = NDArray[np.float64]

#: Debian's build: 32-bit labels, double precision.
_LABEL = np.dtype("<i4")
_ARCH = "LSB;label=32;scalar=64"


def _header(kind: str, location: str, name: str, *, binary: bool = True) -> str:
    """The FoamFile dictionary that opens every file."""
    form = f'binary;\n    arch "{_ARCH}"' if binary else "ascii"
    return (
        f'FoamFile\n{{\n    version 2.0;\n    format {form};\n    class {kind};\n    location "{location}";\n'
        f"    object {name};\n}}\n"
    )


def _list(values: NDArray[np.generic]) -> bytes:
    """A binary list: its length, then the raw values in parentheses."""
    return f"{len(values)}\n(".encode() + values.tobytes() + b")\n"


def write_dictionary(case: Path, location: str, name: str, content: str, kind: str = "dictionary") -> None:
    """An ASCII file ``case/location/name``."""
    folder = case / location
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text(_header(kind, location, name, binary=False) + content, encoding="ascii")


def write_polymesh(mesh: PolyMesh, case: Path) -> None:
    """The five files of ``case/constant/polyMesh``."""
    folder = case / "constant" / "polyMesh"
    folder.mkdir(parents=True, exist_ok=True)

    def write(name: str, kind: str, *parts: bytes) -> None:
        (folder / name).write_bytes(_header(kind, "constant/polyMesh", name).encode() + b"".join(parts))

    offsets = np.concatenate([[0], np.cumsum((mesh.faces >= 0).sum(axis=1))])
    write("points", "vectorField", _list(mesh.points.astype("<f8")))
    write("faces", "faceCompactList", _list(offsets.astype(_LABEL)), _list(mesh.faces[mesh.faces >= 0].astype(_LABEL)))
    write("owner", "labelList", _list(mesh.owner.astype(_LABEL)))
    write("neighbour", "labelList", _list(mesh.neighbour.astype(_LABEL)))
    patches = "".join(
        f"{p.name}\n{{\n    type {p.kind};\n    nFaces {p.count};\n    startFace {p.start};\n}}\n" for p in mesh.patches
    )
    write_dictionary(case, "constant/polyMesh", "boundary", f"{len(mesh.patches)}\n(\n{patches})\n", "polyBoundaryMesh")


def write_point_field(case: Path, time: int, name: str, values: Floats, patches: dict[str, str]) -> None:
    """A displacement at the points (p, 3) with boundary conditions ``{patch: its dictionary's content}``."""
    folder = case / str(time)
    folder.mkdir(parents=True, exist_ok=True)
    boundary = "".join(f"    {patch} {{ {content} }}\n" for patch, content in patches.items())
    field = b"nonuniform List<vector> " + _list(values.astype("<f8"))[:-1] if values.any() else b"uniform (0 0 0)"
    (folder / name).write_bytes(
        _header("pointVectorField", str(time), name).encode()
        + b"dimensions [0 1 0 0 0 0 0];\ninternalField "
        + field
        + f";\nboundaryField\n{{\n{boundary}}}\n".encode()
    )


def read_points(path: Path) -> Floats:
    """(p, 3) points of a binary ``points`` file.

    Raises
    ------
    ValueError
        If the file has no binary list of vectors.
    """
    content = path.read_bytes()
    start = re.search(rb"\}.*?\n\s*(\d+)\s*\(", content, re.DOTALL)
    if start is None or b"binary" not in content[: start.start()]:
        raise ValueError(f"{path}: expected a binary list of points")
    count = int(start.group(1))
    return np.frombuffer(content, "<f8", 3 * count, start.end()).reshape(count, 3).copy()
