"""A small case that tests vary: a square of triangles with a square hole, which moves."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from mesh_motion_server.files import MeshFile, write_npz

MakeCase = Callable[..., Path]

TEXT = """
[mesh]
file = "mesh.npz"
[patches]
block = "moving"
outer = "fixed"
[[motion]]
patch = "block"
rigid = { translation = [0.05, 0.02], rotation = 10.0, centre = [0.5, 0.5] }
[steps]
count = 2
[method]
support_radius = 0.6
correction = "none"
"""


def square_with_hole(n: int = 12) -> MeshFile:
    """The unit square in n × n squares of two triangles each, without the middle third."""
    grid = np.linspace(0.0, 1.0, n + 1)
    points = np.array([(x, y) for y in grid for x in grid])
    number = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    lower, upper = n // 3, n - n // 3
    keep = [(i, j) for i in range(n) for j in range(n) if not (lower <= i < upper and lower <= j < upper)]
    quads = np.array([(number[i, j], number[i, j + 1], number[i + 1, j + 1], number[i + 1, j]) for i, j in keep])
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    used = np.unique(triangles)
    renumber = np.full(len(points), -1)
    renumber[used] = np.arange(len(used))
    points, triangles = points[used], renumber[triangles]
    x, y = points.T
    outer = np.flatnonzero((x == 0) | (x == 1) | (y == 0) | (y == 1))
    block = np.flatnonzero((np.abs(x - 0.5) < 1 / 6 + 1e-9) & (np.abs(y - 0.5) < 1 / 6 + 1e-9))
    return MeshFile(points, {"triangle": triangles}, {"block": block, "outer": outer}, Path("mesh.npz"))


def case_in(folder: Path, *replacements: tuple[str, str], mesh: MeshFile | None = None) -> Path:
    text = TEXT
    for old, new in replacements:
        assert old in text
        text = text.replace(old, new)
    folder.mkdir(exist_ok=True)
    write_npz(folder / "mesh.npz", mesh or square_with_hole())
    (folder / "case.toml").write_text(text, encoding="utf-8")
    return folder / "case.toml"


@pytest.fixture
def make_case(tmp_path: Path) -> MakeCase:
    return partial(case_in, tmp_path / "case")
