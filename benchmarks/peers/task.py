"""The input of every system: a mesh, the fixed nodes, and the positions of the moving nodes after each step.

Needs numpy only, because the workers of other systems import it in their own environments.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Task", "step_file"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Task:
    """One mesh and one motion.

    Attributes
    ----------
    points : (n, d) array
        Reference coordinates.
    cells : dict of (m, k) int64 or int32 arrays
        Connectivity by cell type, in the node order of VTK.
    moving, fixed : (k,), (f,) int64 arrays
        Nodes that are displaced, and boundary nodes that stay.
    displacements : (S, k, d) array
        Total displacement of ``moving`` since the reference mesh after each of S steps.
    """

    points: Floats
    cells: Mapping[str, NDArray[np.integer]]
    moving: Ints
    fixed: Ints
    displacements: Floats

    @property
    def steps(self) -> int:
        """Number of steps S."""
        return len(self.displacements)

    def targets(self, step: int) -> Floats:
        """(k, d) positions of ``moving`` after a step, counted from 0."""
        positions: Floats = self.points[self.moving] + self.displacements[step]
        return positions

    def save(self, path: Path) -> None:
        """Write to an .npz file."""
        arrays: dict[str, Any] = {f"cells_{name}": nodes for name, nodes in self.cells.items()}
        for name in ("points", "moving", "fixed", "displacements"):
            arrays[name] = getattr(self, name)
        np.savez(path, **arrays)

    @classmethod
    def load(cls, path: Path) -> Task:
        """Read what :meth:`save` wrote."""
        with np.load(path) as content:
            cells = {key.removeprefix("cells_"): content[key] for key in content.files if key.startswith("cells_")}
            return cls(content["points"], cells, content["moving"], content["fixed"], content["displacements"])


def step_file(folder: Path, step: int) -> Path:
    """The file to which a system writes the positions (n, d) after a step, counted from 0."""
    return folder / f"step_{step + 1:04d}.npy"
