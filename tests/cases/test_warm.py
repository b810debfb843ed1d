"""The kernels are compiled before anybody waits for them: all of those that the numerics call from Python."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from mesh_motion_server.cases import warm
from mesh_motion_server.cases.warm import tiny_meshes
from mesh_motion_server.numerics.cells import CELL_TYPES
from mesh_motion_server.numerics.metrics import cell_quality, reference_sizes

MESHES = dict(tiny_meshes())


def test_there_is_one_of_every_type() -> None:
    assert set(MESHES) == set(CELL_TYPES)


@pytest.mark.parametrize("name", MESHES)
def test_the_tiny_meshes_fill_the_unit_cube_with_valid_cells(name: str) -> None:
    points, cells = MESHES[name]
    sizes = reference_sizes(points, cells)
    assert not cell_quality(points, cells, sizes).inverted.any()
    assert CELL_TYPES[name].size_factor * sizes.sum() == pytest.approx(1.0)
    assert np.ptp(points, axis=0) == pytest.approx(np.ones(points.shape[1]))


NUMERICS = Path(warm.__file__).parents[1] / "numerics"
UNCOMPILED = """
import importlib, sys
from numba.core.dispatcher import Dispatcher
from mesh_motion_server.cases.warm import compile_kernels
compile_kernels()
for line in sys.stdin.read().split():
    module, name = line.split(":")
    kernel = getattr(importlib.import_module(module), name)
    assert isinstance(kernel, Dispatcher), line
    if not kernel.signatures:
        print(line)
"""


def _is_compiled(function: ast.FunctionDef) -> bool:
    return any("njit" in ast.unparse(decorator) for decorator in function.decorator_list)


def _kernels_called_from_python() -> set[str]:
    """``module:name`` of every compiled function that a function which is not compiled calls or passes on."""
    trees = {path: ast.parse(path.read_text(encoding="utf-8")) for path in NUMERICS.rglob("*.py")}
    functions = {path: [n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef)] for path, tree in trees.items()}
    compiled = {path: {f.name for f in own if _is_compiled(f)} for path, own in functions.items()}
    by_module = {_module(path): names for path, names in compiled.items()}
    found = set()
    for path, tree in trees.items():
        known = {name: _module(path) for name in compiled[path]}
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and node.module in by_module:
                known.update({a.name: node.module for a in node.names if a.name in by_module[node.module]})
        for function in functions[path]:
            if not _is_compiled(function):
                names = {n.id for n in ast.walk(function) if isinstance(n, ast.Name)}
                found.update(f"{known[name]}:{name}" for name in names & set(known))
    return found


def _module(path: Path) -> str:
    return ".".join(("mesh_motion_server", *path.relative_to(NUMERICS.parent).with_suffix("").parts))


def test_every_kernel_is_compiled_beforehand() -> None:
    kernels = _kernels_called_from_python()
    assert len(kernels) > 30
    told = subprocess.run(
        [sys.executable, "-c", UNCOMPILED], input="\n".join(kernels), capture_output=True, text=True, check=True
    )
    assert told.stdout.split() == []
