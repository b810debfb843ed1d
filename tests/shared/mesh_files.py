"""Common parts of tests of mesh files: Gmsh without output, refusals in one line, arrays as lists."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.files import read_mesh


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
