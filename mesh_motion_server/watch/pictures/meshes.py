"""Read the stored meshes for pictures before and after."""

import re
from pathlib import Path
from xml.etree import ElementTree as Xml

import numpy as np

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.files import read_mesh
from mesh_motion_server.numerics.arrays import Floats
from mesh_motion_server.numerics.mesh.boundary_facets import boundary_nodes
from mesh_motion_server.numerics.mesh.cells import CellTable
from mesh_motion_server.numerics.mesh.finite_volume import FACE_METRICS, cell_values
from mesh_motion_server.numerics.quality.metrics import cell_quality
from mesh_motion_server.numerics.quality.orientation import oriented_at_rest
from mesh_motion_server.watch.pictures.before_after import MeshPair
from mesh_motion_server.watch.pictures.runs import read_played
from mesh_motion_server.watch.pictures.snapshot import Snapshot

__all__ = ["pair_of", "played_pair"]


#: A boundary node has moved if its distance from its old position is above this share of the mesh's extent.
_MOVED = 1e-9
#: Values of faces at the ends of the colours; checkMesh warns of a skewness above 4.
_SCALES = {"non-orthogonality": (90.0, 0.0), "face-skewness": (4.0, 0.0)}


def played_pair(folder: Path, metric: str | None = None, first: int | None = None, last: int | None = None) -> MeshPair:
    """The meshes of a run that ``mesh-motion play`` wrote to a folder: at opening, and after its worst step.

    Parameters
    ----------
    metric : str, optional
        None: size-skew; one of :data:`~.runs.METRICS` or FACE_METRICS.
    first, last : int, optional
        Other steps of the series.

    Raises
    ------
    InvalidInput
        If there is no series, or it does not have these steps.
    """
    of_faces = metric in FACE_METRICS
    run = read_played(folder, None if of_faces else metric)
    series = _series(folder)
    written = [i for i, step in enumerate(run.step) if int(step) in series and step > (first or 0)]
    note = ""
    if last is None:
        if not written:
            raise InvalidInput(f"{folder}: the series has no step after {first or 0}", hint="play writes mesh.pvd")
        order = -np.nan_to_num(run.non_orthogonality) if of_faces else run.actual.minimum
        last = int(run.step[min(written, key=lambda i: float(order[i]))])
        note = ("the least orthogonal" if of_faces else "the worst") if len(written) > 1 else ""
    opening = read_mesh(_file(series, 0, folder))
    steps = (first or 0, last)
    points = [read_mesh(_file(series, step, folder)).points for step in steps]
    pair = pair_of(opening.points, opening.cell_table, *points, steps=steps, metric=metric or run.metric)
    return MeshPair(run.label, metric or run.metric, *pair, np.empty((0, opening.dimension)), note)


def pair_of(
    reference: Floats, cells: CellTable, before: Floats, after: Floats, *, steps: tuple[int, int], metric: str
) -> tuple[Snapshot, Snapshot]:
    """Snapshots of a mesh at two times, its quality against the ``reference`` coordinates (n, d).

    Raises
    ------
    InvalidInput
        If the mesh has one dimension: there is nothing to draw.
    """
    if cells.dimension < 2:
        raise InvalidInput("a mesh of one dimension has no picture", hint="--show history draws its quality")
    cells, sizes = oriented_at_rest(reference, cells)
    edge = boundary_nodes(cells)
    far = np.abs(after[edge] - before[edge]).max(axis=1) > _MOVED * float(np.ptp(reference, axis=0).max())

    def snapshot(step: int, points: Floats) -> Snapshot:
        quality = cell_quality(points, cells, sizes)
        values = cell_values(points, cells, metric) if metric in FACE_METRICS else quality.metric(metric)
        return Snapshot(step, points, cells, values, edge[far], quality.inverted, _SCALES.get(metric, (0.0, 1.0)))

    return snapshot(steps[0], before), snapshot(steps[1], after)


def _series(folder: Path) -> dict[int, Path]:
    """The file of each step of mesh.pvd."""
    path = folder / "mesh.pvd"
    try:
        entries = Xml.parse(path).getroot().iter("DataSet")
        return {round(float(entry.attrib["timestep"])): folder / Path(entry.attrib["file"]).name for entry in entries}
    except (OSError, Xml.ParseError, KeyError, ValueError) as error:
        raise InvalidInput(
            f"{path}: not readable as the series that play writes: {error}",
            hint="play the case again: mesh-motion play CASE.toml --out DIR",
        ) from None


def _file(series: dict[int, Path], step: int, folder: Path) -> Path:
    """The file of a step."""
    if step not in series:
        raise InvalidInput(
            f"--steps: the series in {folder} has no step {step}; it has {_listed(sorted(series))}",
            hint="play --every 1 writes every step",
        )
    return series[step]


def _listed(steps: list[int]) -> str:
    """A text with the numbers, shortened if there are many."""
    text = ", ".join(map(str, steps[:8]))
    return text if len(steps) <= 8 else re.sub(r", \d+$", "", text) + f", … {steps[-1]}"
