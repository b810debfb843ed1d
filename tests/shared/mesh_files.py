"""Common parts of tests of mesh files: Gmsh without output, refusals in one line, arrays as lists."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mesh_motion_numerics.mesh.cells import CELL_TYPES
from mesh_motion_protocol.errors import InvalidInput
from numpy.typing import NDArray

from mesh_motion_server.files import MeshFile, read_mesh


@contextmanager
def quiet_gmsh(needs: str = "") -> Iterator[Any]:
    """Yield Gmsh with an empty model; the test is skipped without Gmsh, or if it was built without the needed parts."""
    gmsh = pytest.importorskip("gmsh", exc_type=OSError)
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        if needs not in gmsh.option.getString("General.BuildOptions"):
            pytest.skip(f"this Gmsh writes no {needs}")
        yield gmsh
    finally:
        gmsh.finalize()


def one_line(path: Path, message: str) -> None:
    """Check that the file is refused in one line that names it."""
    with pytest.raises(InvalidInput, match=message) as caught:
        read_mesh(path)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


def replaced(path: Path, old: str, new: str, count: int = -1) -> Path:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, count))
    return path


def lists(named: Mapping[str, Any]) -> dict[str, Any]:
    """Nodes by name, of patches or cells, as lists for comparison."""
    return {name: nodes.tolist() for name, nodes in named.items()}


def sizes(mesh: MeshFile) -> dict[str, NDArray[np.float64]]:
    """Areas or volumes by corners: exact for simplices and parallelepipeds."""
    found = {}
    for name, nodes in mesh.cells.items():
        corners = mesh.points[nodes[:, CELL_TYPES[name].corner_array]]
        found[name] = np.linalg.det(corners[:, :, 1:] - corners[:, :, :1]).sum(axis=1) * CELL_TYPES[name].size_factor
    return found


def refused_when_damaged(mesh: Path, file: Path, count: int, random: np.random.Generator) -> int:
    """Count refusals of a mesh, each in one line, while ``file`` of it has other bytes or is cut."""
    content, refusals = file.read_bytes(), list[str]()
    for _ in range(count):
        damaged = bytearray(content)
        for place in random.integers(0, len(content), random.integers(1, 4)):
            digit = ord(random.choice(list("0129-. (){};\n")))
            damaged[place] = random.integers(0, 256) if random.random() < 0.5 else digit
        file.write_bytes(damaged[: random.integers(1, len(damaged))] if random.random() < 0.2 else damaged)
        try:
            read_mesh(mesh)
        except InvalidInput as error:
            refusals.append(str(error))
    file.write_bytes(content)
    assert not any("\n" in refusal for refusal in refusals)
    return len(refusals)
