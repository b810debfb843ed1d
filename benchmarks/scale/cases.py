"""The cases: a mesh, and a motion in steady small steps or in one large one."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.peers.meshes import load_or_build
from benchmarks.peers.motions import MOTIONS
from benchmarks.peers.task import Task

__all__ = ["CASES", "MESHES", "SHAPES", "Case"]

#: A steady step is this part of the large one.
_STEADY_PARTS = 50

#: Meshes, smallest first in each dimension, and the large motion of each.
MESHES: dict[str, str] = {"M1": "T1", "M6": "T1", "M2": "T1", "M7": "T1", "M3": "T3", "M4": "T3", "M5": "T3"}

#: Meshes that are not about size: a domain 50 bodies wide, a surface whose spacing varies by 30. Steady steps only.
SHAPES: dict[str, str] = {"W2": "T1", "S2": "T1", "W3": "T3", "S3": "T3"}

_MOTIONS = {**MESHES, **SHAPES}

_METHODS: dict[str, dict[str, Any]] = {
    "steady": {},
    "large": {"correction": "none", "allow_invalid": True},
}


@dataclass(frozen=True)
class Case:
    """A case that is measured.

    Attributes
    ----------
    mesh : str
        One of the peers' meshes.
    kind : {"steady", "large"}
        Successive committed steps, each a fiftieth of the motion, with the default method: the quality stays above the
        threshold, so no correction follows. "large" is the whole motion in one step without correction.
    """

    mesh: str
    kind: str

    @property
    def name(self) -> str:
        """``M3-steady``."""
        return f"{self.mesh}-{self.kind}"

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return 2 if _MOTIONS[self.mesh] == "T1" else 3

    @property
    def method(self) -> dict[str, Any]:
        """Keys of ``[method]``."""
        return _METHODS[self.kind]

    def task(self, folder: Path, steps: int) -> Task:
        """Mesh (built if the folder does not have it yet) and ``steps`` displacements; a large one is repeated."""
        mesh = load_or_build(self.mesh, folder)
        motion, body = MOTIONS[_MOTIONS[self.mesh]], mesh.points[mesh.moving]
        if self.kind == "steady":
            displacements = motion.displacements(body, max(_STEADY_PARTS, steps))[:steps]
        else:
            displacements = np.repeat(motion.displacements(body, 1), steps, axis=0)
        return Task(mesh.points, mesh.cells, mesh.moving, mesh.fixed, displacements)


#: By name.
CASES: dict[str, Case] = {
    case.name: case
    for case in (
        *(Case(mesh, "steady") for mesh in (*MESHES, *SHAPES)),
        *(Case(mesh, "large") for mesh in MESHES),
    )
}
