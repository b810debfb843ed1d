"""A method that cannot move a mesh is refused when the session is built, with the reason."""

import numpy as np
import pytest
from frame_meshes import rotation, square_frame
from mesh_motion_numerics.interpolation.kernels import BASES
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.roles import Patch
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.motion import MotionModel
from mesh_motion_protocol.errors import InvalidInput

USABLE = [name for name, basis in BASES.items() if not basis.unusable]


def model_of(outer: str = "fixed", **choices) -> MotionModel:
    points, cells, patches = square_frame(outer=outer)
    return MotionModel.build(points, cells, patches, Method(**choices))


def turned(model: MotionModel, degrees: float) -> np.ndarray:
    return (model.points[model.roles.moving] - 0.5) @ rotation(degrees).T + 0.5


@pytest.mark.parametrize("basis", ["gauss", "mqb"])
def test_a_basis_without_its_shape_parameter_is_refused_at_the_build(basis: str) -> None:
    with pytest.raises(InvalidInput, match=f"'{basis}' needs a shape parameter"):
        model_of(basis=basis)


def test_a_polynomial_that_the_boundary_does_not_determine_is_refused_at_the_build() -> None:
    points = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
    cells = CellTable.from_arrays({"quad": np.array([[0, 1, 3, 2]])})
    patches = {"bottom": Patch("moving", np.array([0, 1]))}
    with pytest.raises(InvalidInput, match="they span 1 of 2 dimensions"):
        MotionModel.build(points, cells, patches, Method(basis="tps"))
    MotionModel.build(points, cells, patches, Method())


@pytest.mark.parametrize("name", USABLE)
def test_every_usable_basis_moves_a_mesh(name: str) -> None:
    radius = {"support": 1.0, "shape": 0.1, "free": None}[BASES[name].radius_meaning]
    model = model_of(basis=name, support_radius=radius, correction="none")
    motion = model.move(model.points, turned(model, 10.0))
    assert motion.corrected.inverted == 0
    assert np.array_equal(motion.points[model.roles.moving], turned(model, 10.0))
    assert np.array_equal(motion.points[model.roles.fixed], model.points[model.roles.fixed])


def test_the_imposed_gradient_needs_that_of_the_basis_in_1d_only() -> None:
    choices = {"basis": "wendland-c0", "correction": "imposed-gradient"}
    line = CellTable.from_arrays({"line": np.array([[0, 1], [1, 2]])})
    patches = {"ends": Patch("moving", np.array([0, 2]))}
    with pytest.raises(InvalidInput, match="no gradient at a control point"):
        MotionModel.build(np.array([[0.0], [0.5], [1.0]]), line, patches, Method(**choices))
    model_of(**choices)
