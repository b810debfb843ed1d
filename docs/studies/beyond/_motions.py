"""Meshes with a body in a box, and random rigid motions of the body; not used to tune the enrichment's methods."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from mesh_motion_numerics.correction.correction_problem import CorrectionProblem
from mesh_motion_numerics.correction.trial_nodes import TrialMesh
from mesh_motion_numerics.interpolation import evaluation
from mesh_motion_numerics.interpolation.interpolant import Factorization, factorize
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.quality.metrics import reference_sizes
from numpy.typing import NDArray

Floats = NDArray[np.float64]

REFERENCES = Path(__file__).parents[3] / "tests" / "references"
RADIUS = 0.5


@dataclass(frozen=True, eq=False)
class Body:
    """A mesh of the unit square or cube with a fixed outer boundary and a body.

    Attributes
    ----------
    points : (n, d) array
    body : (k,) int array
    held : (n,) bool array
    sizes : (m,) array
    factorization : Factorization
        Of the held nodes.
    """

    points: Floats
    cells: CellTable
    body: NDArray[np.int64]
    held: NDArray[np.bool_]
    sizes: Floats
    factorization: Factorization

    @classmethod
    def build(cls, points: Floats, cells: CellTable, body: NDArray[np.int64], outer: NDArray[np.int64]) -> Body:
        """The mesh with its boundary factorized, R = 0.5."""
        held = np.zeros(len(points), dtype=bool)
        held[body] = held[outer] = True
        factorization = factorize(points[held], support_radius=RADIUS)
        return cls(points, cells, body, held, reference_sizes(points, cells), factorization)

    def judge(self, metric: str = "size-skew") -> TrialMesh:
        """Function that returns the quality of trial positions."""
        return TrialMesh(self.points, self.cells, self.sizes, self.held, metric)

    def moved(self, displacement: Floats) -> CorrectionProblem:
        """The standard motion for the boundary rows of a displacement (n, d)."""
        interpolant = self.factorization.solve(displacement[self.held])
        standard = self.points + evaluation.displacement(interpolant, self.points)
        standard[self.held] = (self.points + displacement)[self.held]
        return CorrectionProblem(self.points, standard, self.held, self.cells, self.sizes, self.factorization)

    def rigid(self, shift: Floats, degrees: float) -> CorrectionProblem:
        """Displacement of the body, shifted and turned about the centre (in 3D about the z axis)."""
        c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
        turned = self.points - 0.5
        turned[:, :2] = turned[:, :2] @ np.array([[c, s], [-s, c]])
        displacement = np.zeros_like(self.points)
        displacement[self.body] = (turned + 0.5 + shift - self.points)[self.body]
        return self.moved(displacement)


@cache
def stored(name: str) -> Body:
    """A mesh of tests/references."""
    with np.load(REFERENCES / f"{name}.npz") as data:
        cells = {key.removeprefix("cells_"): data[key] for key in data if key.startswith("cells_")}
        body = data["patch_body"] if "patch_body" in data else data["patch_block"]
        return Body.build(data["points"], CellTable.from_arrays(cells), body, data["patch_outer"])


def random_motions(body: Body, count: int, seed: int) -> Iterator[CorrectionProblem]:
    """Shifts up to 0.3 (in 3D 0.2) along each axis and turns up to 75°, all below the threshold without correction."""
    rng, d = np.random.default_rng(seed), body.points.shape[1]
    reach = 0.3 if d == 2 else 0.2
    found = 0
    while found < count:
        problem = body.rigid(rng.uniform(-reach, reach, size=(d,)), float(rng.uniform(-75.0, 75.0)))
        if body.judge().quality(problem.standard).min() < 0.2:
            found += 1
            yield problem
