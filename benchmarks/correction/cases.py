"""The cases: a mesh, a motion in one step that leaves it below the threshold, and the correction's target."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mesh_motion_numerics.interpolation.factor_source import MakeEachTime
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.roles import Patch
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.motion import MotionModel
from mesh_motion_numerics.stopwatch import Stopwatch
from numpy.typing import NDArray

from benchmarks.peers.meshes import BenchmarkMesh, load_or_build
from benchmarks.peers.motions import MOTIONS

__all__ = ["CASES", "Case", "standard_file", "standard_positions"]

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Case:
    """A case that is measured.

    Attributes
    ----------
    mesh, motion : str
        Of the peers' tables.
    target : float
        Minimum size-skew to be reached; inf for the maximum.
    seconds : float or None
        The aim on two quiet cores, if any.
    """

    mesh: str
    motion: str
    target: float
    seconds: float | None = None

    @property
    def asked(self) -> str:
        """In words."""
        return "maximum" if math.isinf(self.target) else f"{self.target:.2f}"

    def read_mesh(self, folder: Path) -> BenchmarkMesh:
        """The case's mesh; built if the folder does not have it yet."""
        return load_or_build(self.mesh, folder)


#: By name.
CASES: dict[str, Case] = {
    "M2-0.20": Case("M2", "T1", 0.20),
    "M3-0.20": Case("M3", "T3", 0.20, 2.0),
    "M4-0.20": Case("M4", "T3", 0.20, 6.0),
    "M3-0.28": Case("M3", "T3", 0.28, 6.0),
    "M4-0.25": Case("M4", "T3", 0.25, 45.0),
    "H1-max": Case("H1", "T3", math.inf),
    "M3-max": Case("M3", "T3", math.inf, 15.0),
    "M2-max": Case("M2", "T1", math.inf),
}


def standard_file(case: Case, folder: Path) -> Path:
    """Where :func:`standard_positions` keeps them."""
    return folder / f"{case.mesh}-{case.motion}.npy"


def standard_positions(case: Case, folder: Path) -> Floats:
    """Node positions (n, d) after the standard motion; computed once, then read from the folder."""
    path = standard_file(case, folder)
    if not path.exists():
        mesh = case.read_mesh(folder)
        patches = {"body": Patch("moving", mesh.moving), "box": Patch("fixed", mesh.fixed)}
        model = MotionModel.build(
            mesh.points, CellTable.from_arrays(mesh.cells), patches, Method(quality_metric="size-skew")
        )
        body = mesh.points[model.roles.moving]
        targets = body + MOTIONS[case.motion].displacements(body, 1)[0]
        trial = model.standard_motion.trial(mesh.points, targets, MakeEachTime(), Stopwatch())
        np.save(path, trial.points)
    return np.asarray(np.load(path))
