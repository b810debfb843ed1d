"""A square with a block in it, whose lower and upper halves are two wet patches; a server; the stub of preCICE."""

import sys
from pathlib import Path

import numpy as np
import pytest
from frame_meshes import tensor_grid, without_unused
from mesh_motion_client import Mesh, Patch

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

from precice_stub import Participant as Stub  # noqa: E402

SIDE, LOW, HIGH = 10, 4, 6
MOTION = [[0.05, 0.02], [-0.03, 0.04]]


def square_with_block():
    points, quads = tensor_grid(*[np.arange(SIDE + 1)] * 2)
    middle = points[quads].mean(axis=1)
    points, quads = without_unused(points, quads[~((middle > LOW) & (middle < HIGH)).all(axis=1)])
    y, x = points.T  # x fastest
    on_block = (x >= LOW) & (x <= HIGH) & (y >= LOW) & (y <= HIGH)
    middle = (LOW + HIGH) // 2
    patches = {
        "outer": np.flatnonzero((x == 0) | (x == SIDE) | (y == 0) | (y == SIDE)),
        "lower": np.flatnonzero(on_block & (y <= middle)),
        "upper": np.flatnonzero(on_block & (y >= middle)),  # two nodes lie on both
    }
    return np.stack([x, y], axis=1) / SIDE, quads[:, [[0, 3, 2], [0, 2, 1]]].reshape(-1, 3), patches


@pytest.fixture(scope="session")
def square():
    points, triangles, patches = square_with_block()
    roles = {"outer": "fixed", "lower": "moving", "upper": "moving"}
    return Mesh(points, {"triangle": triangles}, {name: Patch(roles[name], patches[name]) for name in patches})


@pytest.fixture
def script(square):
    def make(iterations, received=None, **more):
        volume = {"points": None if received is None else received.tolist(), "data": ["NodeDisplacement"]}
        wet = {"points": None, "data": ["Displacement"]}
        return {
            "meshes": {"Lower": wet, "Upper": wet, "Volume": volume},
            "motion": MOTION,
            "iterations": iterations,
        } | more

    return make


@pytest.fixture
def stub(script):
    return lambda *arguments, **more: Stub("MeshMotion", script(*arguments, **more), 0, 1)


@pytest.fixture
def case(tmp_path, square):
    arrays = {f"patch_{name}": patch.nodes for name, patch in square.patches.items()}
    np.savez(tmp_path / "mesh.npz", points=square.points, cells_triangle=square.cells["triangle"], **arrays)

    def write(coupling="", volume="", method="", text=None):
        path = tmp_path / "mesh-motion.toml"
        path.write_text(
            text
            or f"""
[precice]
config = "script.json"
[mesh]
file = "mesh.npz"
[patches]
outer = "fixed"
lower = "moving"
upper = "moving"
[[read]]
patch = "lower"
mesh = "Lower"
[[read]]
patch = "upper"
mesh = "Upper"
[write]
mesh = "Volume"
{volume}
[coupling]
{coupling}
[method]
support_radius = 0.8
{method}
"""
        )
        return path

    return write
