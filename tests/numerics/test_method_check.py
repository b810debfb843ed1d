"""A method that cannot move a mesh is refused when the session is built, with the reason."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from frame_meshes import rotation, square_frame

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.numerics.interpolation.factor_source import factorization_of
from mesh_motion_server.numerics.interpolation.kernels import BASES
from mesh_motion_server.numerics.mesh.cells import CellTable
from mesh_motion_server.numerics.mesh.roles import Patch
from mesh_motion_server.numerics.method import Method
from mesh_motion_server.numerics.motion.motion import MotionModel

USABLE = [name for name, basis in BASES.items() if not basis.unusable]


def model_of(outer: str = "fixed", **choices) -> MotionModel:
    points, cells, patches = square_frame(outer=outer)
    return MotionModel.build(points, cells, patches, Method(**choices))


def turned(model: MotionModel, degrees: float) -> np.ndarray:
    return (model.points[model.roles.moving] - 0.5) @ rotation(degrees).T + 0.5


@pytest.mark.parametrize(
    ("choices", "says"),
    [
        ({"basis": "spline"}, "unknown basis 'spline'"),
        ({"basis": "qb"}, r"'qb' cannot interpolate: it is a polynomial.*rank d \+ 2"),
        ({"basis": "wendland-c0", "predictor": "centre-gradient"}, "no gradient at a control point"),
        ({"basis": "ctps-c0", "predictor": "edge-midpoint-gradient"}, "no gradient at a control point"),
        ({"basis": "gauss"}, "'gauss' needs a shape parameter"),
        ({"basis": "mqb"}, "'mqb' needs a shape parameter"),
        ({"basis": "tps", "polynomial": "none"}, "it needs a polynomial"),
        ({"basis": "mqb", "support_radius": 0.1, "polynomial": "none"}, "it needs a polynomial"),
    ],
)
def test_an_unusable_basis_is_refused_at_the_build(choices: dict[str, object], says: str) -> None:
    with pytest.raises(InvalidInput, match=says):
        model_of(**choices)


def test_a_polynomial_that_the_boundary_does_not_determine_is_refused_at_the_build() -> None:
    points = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
    cells = CellTable.from_arrays({"quad": np.array([[0, 1, 3, 2]])})
    patches = {"bottom": Patch("moving", np.array([0, 1]))}
    with pytest.raises(InvalidInput, match="they span 1 of 2 dimensions"):
        MotionModel.build(points, cells, patches, Method(polynomial="linear"))
    MotionModel.build(points, cells, patches, Method())


@pytest.mark.parametrize("name", USABLE)
@pytest.mark.parametrize("polynomial", ["auto", "linear"])
def test_every_usable_basis_moves_a_mesh(name: str, polynomial: str) -> None:
    radius = {"support": 1.0, "shape": 0.1, "free": None}[BASES[name].radius_meaning]
    model = model_of(basis=name, support_radius=radius, polynomial=polynomial, correction="none")
    motion = model.move(model.points, turned(model, 10.0))
    assert motion.corrected.inverted == 0
    assert np.array_equal(motion.points[model.roles.moving], turned(model, 10.0))
    assert np.array_equal(motion.points[model.roles.fixed], model.points[model.roles.fixed])


def test_the_polynomial_is_part_of_the_motion_and_of_the_cache_key() -> None:
    points = square_frame()[0]
    keys = []

    class Noting:
        def get_or_make(self, key, make):
            keys.append(key)
            return make(), False

    method = Method(support_radius=1.0)
    for polynomial in ("auto", "none", "linear"):
        factorization_of(points[::7], replace(method, polynomial=polynomial), Noting())
    assert len(set(keys)) == 3
    plain, linear = (model_of(polynomial=p, correction="none", support_radius=0.5) for p in ("auto", "linear"))
    moved = [model.move(points, turned(model, 20.0)).points for model in (plain, linear)]
    assert np.abs(moved[0] - moved[1]).max() > 1e-4
    none = model_of(polynomial="none", correction="none", support_radius=0.5)
    assert np.array_equal(none.move(points, turned(none, 20.0)).points, moved[0])


def test_a_turn_of_all_prescribed_nodes_is_recovered_with_the_polynomial() -> None:
    """Fig 2.2: a boundary that moves as a whole carries the mesh with it, although nothing took the rigid part out."""
    model = model_of(outer="moving", polynomial="linear")
    factorization = factorization_of(model.points[model.roles.all], model.method, _Each())[0]
    told = turned(model, 30.0) - model.points[model.roles.moving]
    found = model.points + model.evaluator.displacement(factorization.solve(told), model.points)
    assert np.abs(found - ((model.points - 0.5) @ rotation(30.0).T + 0.5)).max() < 1e-12


class _Each:
    def get_or_make(self, key, make):
        del key
        return make(), False


def test_the_imposed_gradient_needs_that_of_the_basis_in_1d_only() -> None:
    choices = {"basis": "wendland-c0", "correction": "imposed-gradient"}
    line = CellTable.from_arrays({"line": np.array([[0, 1], [1, 2]])})
    patches = {"ends": Patch("moving", np.array([0, 2]))}
    with pytest.raises(InvalidInput, match="no gradient at a control point"):
        MotionModel.build(np.array([[0.0], [0.5], [1.0]]), line, patches, Method(**choices))
    model_of(**choices)
