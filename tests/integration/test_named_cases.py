"""The named motions of the unit square in one step: corrected to nine tenths of the best known, end to end.

*Best known* is the largest minimum size-skew found by any method with every node free, on meshes of this spacing.
"""

from pathlib import Path

import numpy as np
import pytest

from mesh_motion_server.files import read_mesh
from mesh_motion_server.numerics.mesh.roles import Patch
from mesh_motion_server.numerics.method import Method
from mesh_motion_server.numerics.motion.motion import MotionModel

EXAMPLES = Path(__file__).parents[2] / "examples"
BLOCK, SLAB = EXAMPLES / "thesis_dx" / "mesh.npz", EXAMPLES / "thesis_rotation" / "mesh.npz"

#: name: mesh, translation, degrees, best known
CASES = {
    "dx -0.3": (BLOCK, (-0.3, 0.0), 0.0, 0.336),
    "dx dy -0.25": (BLOCK, (-0.25, -0.25), 0.0, 0.300),
    "-0.2 -0.2 +60°": (SLAB, (-0.2, -0.2), 60.0, 0.414),
    "dx -0.38": (BLOCK, (-0.38, 0.0), 0.0, 0.123),
    "rotate 90°": (SLAB, (0.0, 0.0), 90.0, 0.507),
    "rotate 180°": (SLAB, (0.0, 0.0), 180.0, 0.286),
}


def model_of(path: Path, **choices: object) -> MotionModel:
    mesh = read_mesh(path)
    roles = {"block": "moving", "outer": "fixed"}
    patches = {name: Patch(roles[name], nodes) for name, nodes in mesh.patches.items()}
    return MotionModel.build(mesh.points, mesh.cell_table, patches, Method(support_radius=0.5, **choices))


def told(model: MotionModel, shift: tuple[float, float], degrees: float) -> np.ndarray:
    a = np.deg2rad(degrees)
    turn = np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]])
    return (model.points[model.roles.moving] - 0.5) @ turn.T + 0.5 + shift


@pytest.mark.parametrize(("correction", "share"), [("optimised", 0.9), ("enrichment", 0.65)])
@pytest.mark.parametrize("name", CASES)
def test_the_share_of_the_best_known(name: str, correction: str, share: float) -> None:
    path, shift, degrees, best_known = CASES[name]
    model = model_of(path, correction=correction, correction_target="maximum" if share < 0.9 else "auto")
    targets = told(model, shift, degrees)
    motion = model.move(model.points, targets)
    assert motion.corrected.inverted == 0
    assert motion.corrected.metric.min >= share * best_known
    assert len(motion.correction.enrichment_points) <= 20
    assert np.array_equal(motion.points[model.roles.moving], targets)
    assert np.array_equal(motion.points[model.roles.fixed], model.points[model.roles.fixed])


def test_thirty_of_thirty_random_motions_are_valid() -> None:
    """|dx|, |dy| ≤ 0.33, |angle| ≤ 90°, the slab at least 0.02 from the walls; plain interpolation manages a third."""
    model = model_of(SLAB)
    random = np.random.default_rng(20261121)
    motions = []
    while len(motions) < 30:
        targets = told(model, tuple(random.uniform(-0.33, 0.33, 2)), random.uniform(-90.0, 90.0))
        if targets.min() >= 0.02 and targets.max() <= 0.98:
            motions.append(model.move(model.points, targets))
    assert [motion.corrected.inverted for motion in motions] == [0] * 30
    assert sum(motion.standard.inverted == 0 for motion in motions) < 20
