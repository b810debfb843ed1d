"""Write the mesh of a refused step for inspection: refused.vtu, and its worst cells."""

from pathlib import Path
from typing import Any

import numpy as np
from mesh_motion_numerics.arrays import Floats
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.quality.metrics import AtRest, cell_quality
from mesh_motion_protocol.errors import MeshMotionError

from mesh_motion_server.cases.prediction import Prediction
from mesh_motion_server.cases.records import VTU_METRICS
from mesh_motion_server.files import write_vtu


def write_refused(
    path: Path, prediction: Prediction, committed: Floats, step: int, cells: CellTable, sizes: AtRest
) -> tuple[Floats | None, list[dict[str, Any]]]:
    """Write the refused mesh of a step with its worst cells marked.

    Parameters
    ----------
    path : path
        Path of the VTU file.
    committed : (n, d) array
        Coordinates before the step, mesh length unit.
    sizes : AtRest
        Sizes of the cells at opening.

    Returns
    -------
    points : (n, d) array or None
        Coordinates of the refused mesh; None if no mesh was found.
    worst : list of dict
        As returned by :meth:`.Prediction.worst`.
    """
    try:
        points = prediction.trial(committed, step)
    except MeshMotionError:
        return None, []
    worst = prediction.worst(points)
    quality = cell_quality(points, cells, sizes)
    mark = np.zeros(len(cells), dtype=np.int8)
    mark[[cell["number"] for cell in worst]] = 1
    write_vtu(
        path,
        points,
        cells,
        point_data={"displacement": points - prediction.reference},
        cell_data={name.replace("-", "_"): quality.metric(name) for name in VTU_METRICS} | {"worst": mark},
    )
    return points, worst
