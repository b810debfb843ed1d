"""What clients that move and judge their own cells are tested with: settings, boxes whole and cut, how they bend."""

from pathlib import Path

import numpy as np
from box_meshes import box_mesh
from mesh_motion_client import Mesh, Patch

from mesh_motion_server.files.mesh_file import MeshFile
from mesh_motion_server.files.partitions import partitions

SETTINGS = {
    "displacement": "absolute",
    "correction": "none",
    "sub_steps": "never",
}
CORRECTED = SETTINGS | {"correction": "optimised", "correction_target": "threshold", "quality_threshold": 0.5}
ROLES = {"body": "moving", "outer": "fixed"}


def box_file(kind, count):
    """A box as if it were read from a file."""
    box = box_mesh(kind, count)
    cells = {block.type.name: np.asarray(block.nodes, dtype=np.int64) for block in box.cells}
    patches = {"body": np.unique(box.body), "outer": np.unique(box.outer)}
    return MeshFile(box.points, cells, patches, Path(f"{kind} {count}"))


def mesh_of(file):
    """A mesh, or a partition of one, as the client takes it."""
    patches = {name: Patch(ROLES[name], nodes) for name, nodes in file.patches.items()}
    return Mesh(file.points, file.cells, patches, file.global_ids)


def whole(kind, count):
    """The mesh in one piece."""
    return mesh_of(box_file(kind, count))


def cut(kind, count, ranks):
    """The mesh in several pieces."""
    return [mesh_of(part) for part in partitions(box_file(kind, count), ranks)]


def bend(points, step):
    """It grows with the steps."""
    return 0.01 * step * np.sin(3.0 * points[:, ::-1] + step)


def assert_same_quality(found, expected):
    """Bitwise but for means, which are sums in another order, and for which of equally bad cells are named."""
    for name in ("metric", "size", "skew", "size_skew"):
        one, other = ({k: v for k, v in quality[name].items() if k != "mean"} for quality in (found, expected))
        assert one == other
        assert abs(found[name]["mean"] - expected[name]["mean"]) <= 1e-13 * abs(expected[name]["mean"])
    assert (found["cells"], found["inverted"]) == (expected["cells"], expected["inverted"])
    assert [cell["metric"] for cell in found["worst"]] == [cell["metric"] for cell in expected["worst"]]
