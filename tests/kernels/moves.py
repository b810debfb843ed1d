"""Moves of meshes on one, two and three threads; prints ``case threads digest`` for each."""

import hashlib
import sys
from pathlib import Path
from unittest.mock import patch

import mesh_motion_kernels as kernels
import numpy as np
from scipy.spatial.transform import Rotation

sys.path.insert(0, str(Path(__file__).parents[1] / "numerics"))
sys.path.insert(0, str(Path(__file__).parents[2]))
from box_meshes import box_mesh
from mesh_motion_numerics.interpolation.two_scale import factorization
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.motion import MotionModel

from benchmarks.one_scale import in_one_scale

#: A hexahedron in tetrahedra around a diagonal: neighbours are cut the same way.
_SIX = ((0, 1, 2, 6), (0, 2, 3, 6), (0, 3, 7, 6), (0, 7, 4, 6), (0, 4, 5, 6), (0, 5, 1, 6))

#: Mesh, boxes along each axis, degrees that the body turns by, method. The corrections have to work.
CASES: dict[str, tuple[str, int, float, Method]] = {
    "2D dense": ("quad + triangle", 60, 20.0, Method(support_radius=1.0, correction="none")),
    "2D sparse": ("quad + triangle", 60, 10.0, Method(support_radius=0.3, correction="none")),
    "2D corrected": ("quad + triangle", 30, 60.0, Method(support_radius=1.0, quality_threshold=0.3)),
    "2D maximum": (
        "quad + triangle",
        20,
        45.0,
        Method(support_radius=1.0, quality_threshold=0.5, correction_target="maximum"),
    ),
    "2D two scales": ("quad + triangle", 100, 20.0, Method(support_radius=1.5, correction="none")),
    "2D reduced": ("quad + triangle", 60, 20.0, Method(support_radius=1.0, reduction="greedy", correction="none")),
    "3D dense": ("tetra", 15, 20.0, Method(support_radius=1.0, correction="none")),
    "3D corrected": ("tetra", 5, 60.0, Method(support_radius=1.0, quality_threshold=0.4)),
    "3D hexahedra": ("hexahedron", 5, 80.0, Method(support_radius=1.0, quality_threshold=0.45)),
    "3D mixed": ("hexahedron + wedge", 5, 80.0, Method(support_radius=1.0, quality_threshold=0.45)),
    "3D two scales": ("tetra", 20, 20.0, Method(support_radius=1.5, correction="none")),
}


def moved(name: str, finer: int = 1) -> str:
    kind, boxes, degrees, method = CASES[name]
    mesh = box_mesh("hexahedron" if kind == "tetra" else kind, finer * boxes)
    cells = mesh.cells
    if kind == "tetra":
        cells = CellTable.from_arrays({kind: np.concatenate([cells.blocks[0].nodes[:, tetra] for tetra in _SIX])})
    with patch.object(
        factorization, "AUTOMATIC_FROM", 0 if name.endswith("two scales") else factorization.AUTOMATIC_FROM
    ):
        model = MotionModel.build(mesh.points, cells, mesh.patches, method)
    if name.endswith("sparse"):
        model = in_one_scale(model, "sparse")
    turn = Rotation.from_euler("z", degrees, degrees=True).as_matrix()[: model.points.shape[1], : model.points.shape[1]]
    targets = 0.5 + (mesh.points[model.roles.moving] - 0.5) @ turn.T + 0.03
    motion = model.move(mesh.points, targets)
    digest = hashlib.sha256(motion.points.tobytes())
    digest.update(repr((motion.standard, motion.corrected)).encode())
    return digest.hexdigest()


if __name__ == "__main__":
    for threads in (1, 2, 3):
        kernels.set_threads(threads)
        for case in sys.argv[1:] or CASES:
            sys.stdout.write(f"{case}\t{threads}\t{moved(case)}\n")
