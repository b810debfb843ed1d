"""Meshes for the benchmark: the wing of M3 and M4, and several wings side by side, one for each worker."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.meshes import load_or_build
from mesh_motion_server.numerics.mesh.cells import CellTable
from mesh_motion_server.numerics.mesh.roles import Patch

__all__ = ["PartitionCase", "load"]

Floats = NDArray[np.float64]

#: Between boxes that stand side by side, in their length: their walls must not coincide.
_GAP = 0.1
#: Largest displacement of a step, in the box' length.
_AMPLITUDE = 0.003


@dataclass(frozen=True, eq=False)
class PartitionCase:
    """A mesh and its steady motion.

    Attributes
    ----------
    name : str
    points : (n, d) array
    cells : CellTable
    patches : dict of str to Patch
    """

    name: str
    points: Floats
    cells: CellTable
    patches: dict[str, Patch]

    @property
    def boundary(self) -> NDArray[np.int64]:
        """Nodes with a role, ascending."""
        return np.unique(np.concatenate([patch.nodes for patch in self.patches.values()]))

    def displacement(self, body: Floats, step: int) -> Floats:
        """(k, d) of the body's nodes in one of many small steps."""
        return _AMPLITUDE * np.sin(3.0 * body[:, ::-1] + step)


def load(mesh: str, folder: Path, copies: int = 1) -> PartitionCase:
    """``copies`` of a benchmark mesh side by side along x."""
    stored = load_or_build(mesh, folder)
    shifts = np.zeros((copies, stored.points.shape[1]))
    shifts[:, 0] = (1.0 + _GAP) * np.arange(copies)
    points = np.concatenate([stored.points + shift for shift in shifts])

    def repeated(numbers: NDArray[np.integer]) -> NDArray[np.int64]:
        return np.concatenate([np.asarray(numbers, dtype=np.int64) + k * len(stored.points) for k in range(copies)])

    return PartitionCase(
        mesh if copies == 1 else f"{copies} × {mesh}",
        points,
        CellTable.from_arrays({name: repeated(nodes) for name, nodes in stored.cells.items()}),
        {"body": Patch("moving", repeated(stored.moving)), "box": Patch("fixed", repeated(stored.fixed))},
    )
