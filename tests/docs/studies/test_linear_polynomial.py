"""With the linear polynomial of (2.1) every basis reproduces a linear motion, with any solver of its matrix."""

import numpy as np
import pytest
from frame_meshes import cloud
from mesh_motion_numerics.interpolation import evaluation
from mesh_motion_numerics.interpolation.interpolant import factorize
from mesh_motion_numerics.interpolation.kernels import BASES

from docs.studies.thesis._linear_polynomial import WithPolynomial

DEFINITE = sorted(name for name, basis in BASES.items() if not basis.unusable and basis.order == 0)
SOLVERS = ("dense", "sparse", "iterative")


@pytest.mark.parametrize(
    ("name", "solver"), [(n, s) for n in DEFINITE for s in SOLVERS if BASES[n].compact or s != "sparse"]
)
def test_linear_motion_is_reproduced_with_the_polynomial(name, solver):
    points, places = cloud(80, 3), np.random.default_rng(1).uniform(-1, 2, (50, 3))
    matrix, shift = np.random.default_rng(2).standard_normal((3, 3)), np.array([1.0, -2.0, 0.5])
    made = WithPolynomial(
        factorize(points, basis=name, support_radius=0.5 if BASES[name].compact else 0.3, solver=solver)
    )
    got = evaluation.displacement(made.solve(points @ matrix.T + shift), places)
    assert np.max(np.abs(got - (places @ matrix.T + shift))) < 1e-11
