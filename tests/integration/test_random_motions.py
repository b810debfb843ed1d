"""Random motions of the thesis' slab in one step, end to end."""

from pathlib import Path

import numpy as np
from mesh_motion_numerics.mesh.roles import Patch
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.motion import MotionModel

from mesh_motion_server.files import read_mesh

SLAB = Path(__file__).parents[2] / "examples" / "thesis_rotation" / "mesh.npz"


def test_thirty_of_thirty_random_motions_are_valid() -> None:
    """|dx|, |dy| ≤ 0.33, |angle| ≤ 90°, the slab at least 0.02 from the walls; plain interpolation gives a valid mesh
    for a third of them.
    """
    mesh, roles = read_mesh(SLAB), {"block": "moving", "outer": "fixed"}
    patches = {name: Patch(roles[name], nodes) for name, nodes in mesh.patches.items()}
    model = MotionModel.build(mesh.points, mesh.cell_table, patches, Method(support_radius=0.5))
    random = np.random.default_rng(20261121)
    motions = []
    while len(motions) < 30:
        shift, a = random.uniform(-0.33, 0.33, 2), np.deg2rad(random.uniform(-90.0, 90.0))
        turn = np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]])
        targets = (model.points[model.roles.moving] - 0.5) @ turn.T + 0.5 + shift
        if targets.min() >= 0.02 and targets.max() <= 0.98:
            motions.append(model.move(model.points, targets))
    assert [motion.corrected.inverted for motion in motions] == [0] * 30
    assert sum(motion.standard.inverted == 0 for motion in motions) < 20
