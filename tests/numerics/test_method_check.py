"""A method that cannot move a mesh is refused when the session is built, with the reason."""

import numpy as np
import pytest
from frame_meshes import rotation, square_frame
from mesh_motion_numerics.interpolation.kernels import BASES
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.motion import MotionModel

USABLE = [name for name, basis in BASES.items() if not basis.unusable]


def model_of(outer: str = "fixed", **choices) -> MotionModel:
    points, cells, patches = square_frame(outer=outer)
    return MotionModel.build(points, cells, patches, Method(**choices))


def turned(model: MotionModel, degrees: float) -> np.ndarray:
    return (model.points[model.roles.moving] - 0.5) @ rotation(degrees).T + 0.5


@pytest.mark.parametrize("name", USABLE)
def test_every_usable_basis_moves_a_mesh(name: str) -> None:
    radius = {"support": 1.0, "shape": 0.1, "free": None}[BASES[name].radius_meaning]
    model = model_of(basis=name, support_radius=radius, correction="none")
    motion = model.move(model.points, turned(model, 10.0))
    assert motion.corrected.inverted == 0
    assert np.array_equal(motion.points[model.roles.moving], turned(model, 10.0))
    assert np.array_equal(motion.points[model.roles.fixed], model.points[model.roles.fixed])
