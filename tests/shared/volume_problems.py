"""A problem for the tests of every volume reduction."""

import numpy as np
from mesh_motion_numerics.interpolation import evaluation
from mesh_motion_numerics.interpolation.interpolant import factorize

from docs.studies.thesis._volume_reduction import VolumeProblem


def problem_of(d: int = 2, *, length: float | None = None, n: int = 9, shift: float = 0.05) -> VolumeProblem:
    """A small cube that moves in the middle of a held one, and nodes in between."""
    rng = np.random.default_rng(d)
    axis = np.linspace(-1.0, 1.0, n)
    lattice = np.stack(np.meshgrid(*[axis] * d, indexing="ij"), axis=-1).reshape(-1, d)
    outer = lattice[np.abs(lattice).max(axis=1) == 1.0]
    body = 0.1 * outer[::3]
    boundary = np.vstack([body, outer])
    displacement = np.zeros_like(boundary)
    displacement[: len(body)] = shift

    def interpolate(points, values):
        found = factorize(points, support_radius=3.0).solve(values)
        return lambda places: evaluation.displacement(found, places)

    return VolumeProblem(
        boundary=boundary,
        displacement=displacement,
        moving=np.arange(len(boundary)) < len(body),
        nodes=np.vstack([boundary, rng.uniform(-1.0, 1.0, (500, d))]),
        standard=interpolate(boundary, displacement),
        interpolate=interpolate,
        length=length,
    )
