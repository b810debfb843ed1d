"""What a client that moves and judges its own cells is tested with: settings, boxes in one piece, and how they bend."""

import numpy as np
from box_meshes import box_mesh
from mesh_motion_client import Mesh, Patch

SETTINGS = {
    "displacement": "absolute",
    "correction": "none",
    "sub_steps": "never",
    "boundary_layer_thickness": 0.0,
    "quality_report": "every-move",
}
CORRECTED = SETTINGS | {"correction": "optimised", "correction_target": "threshold", "quality_threshold": 0.5}


def whole(kind, count):
    """The mesh in one piece."""
    box = box_mesh(kind, count)
    cells = {block.type.name: block.nodes for block in box.cells}
    return Mesh(box.points, cells, {"body": Patch("moving", box.body), "outer": Patch("fixed", box.outer)})


def bend(points, step):
    """It grows with the steps."""
    return 0.01 * step * np.sin(3.0 * points[:, ::-1] + step)
