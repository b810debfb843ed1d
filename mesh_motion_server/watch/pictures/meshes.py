"""The meshes of a run at two times, for a picture: from a session's folder or from a folder of ``play``."""

import re
from pathlib import Path
from xml.etree import ElementTree as Xml

import numpy as np
from mesh_motion_numerics.arrays import Floats
from mesh_motion_numerics.mesh.boundary_facets import boundary_nodes
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.finite_volume import FACE_METRICS, cell_values
from mesh_motion_numerics.quality.metrics import cell_quality
from mesh_motion_numerics.quality.orientation import oriented_at_rest
from mesh_motion_protocol.errors import DataLoss, InvalidInput

from mesh_motion_server.files import read_mesh
from mesh_motion_server.session.journal.files import read_ledger, read_stored_state
from mesh_motion_server.session.journal.filesystem import PosixFileSystem
from mesh_motion_server.session.journal.mesh_store import MESH
from mesh_motion_server.session.journal.mesh_store import read_mesh as read_stored_mesh
from mesh_motion_server.session.partitions.merging import merge
from mesh_motion_server.session.spec import StoredSpec, spec_bytes
from mesh_motion_server.watch.observation.follow import last_event
from mesh_motion_server.watch.pictures.before_after import MeshPair
from mesh_motion_server.watch.pictures.runs import (
    METRICS,
    check_metric,
    is_played,
    is_session,
    label_of,
    no_run,
    read_played,
)
from mesh_motion_server.watch.pictures.snapshot import Snapshot

#: A boundary node has moved if its distance from its old position is above this share of the mesh's extent.
_MOVED = 1e-9
#: Values of faces at the ends of the colours; checkMesh warns of a skewness above 4.
_SCALES = {"non-orthogonality": (90.0, 0.0), "face-skewness": (4.0, 0.0)}
#: A stored state may be overwritten by later commits while it is read.
_TRIES = 4


def read_pair(folder: Path, metric: str | None = None, first: int | None = None, last: int | None = None) -> MeshPair:
    """The meshes of a run before and after.

    Raises InvalidInput if it is not a run, or does not have these steps. Raises DataLoss if the files of a session do
    not verify.

    Parameters
    ----------
    metric : str, optional
        One of :data:`~.runs.METRICS` or FACE_METRICS; None: a session's own, size-skew of a played case.
    first, last : int, optional
        Steps; by default the opening, and the worst step of a played case or the stored step of a session.
    """
    check_metric(metric, (*METRICS, *FACE_METRICS))
    if is_played(folder):
        return _played_pair(folder, metric, first, last)
    if is_session(folder):
        return _recorded_pair(folder, metric, first, last)
    raise no_run(folder)


def pair_of(
    reference: Floats, cells: CellTable, before: Floats, after: Floats, *, steps: tuple[int, int], metric: str
) -> tuple[Snapshot, Snapshot]:
    """Snapshots of a mesh at two times, its quality against the ``reference`` coordinates (n, d).

    Raises InvalidInput if the mesh has one dimension: there is nothing to draw.
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


def _titles(before: int, after: int, note: str = "") -> tuple[str, str]:
    return f"after step {before}" if before else "at opening", f"after step {after}" + (f" ({note})" if note else "")


# --- sessions --------------------------------------------------------------------------------------------------------


def _recorded_pair(folder: Path, metric: str | None, first: int | None, last: int | None) -> MeshPair:
    """The uploaded mesh of a stored session, and its last stored state; other steps are not stored."""
    spec, files = StoredSpec.from_bytes(spec_bytes(folder)), PosixFileSystem()
    spec.require_cells()
    mesh = merge(read_stored_mesh(folder / MESH, files, read_ledger(folder, files).foundation.mesh))
    step, points = 0, mesh.points.copy()
    if (stored := _stored_state(folder, files)) is not None:
        step, points[mesh.id_order] = stored[0], stored[1][: len(points)]  # without earlier time levels
    if first not in (None, 0) or last not in (None, step):
        raise InvalidInput(
            f"--steps: a session stores its mesh as uploaded and after step {step} only, got "
            f"{'' if first is None else first}:{'' if last is None else last}",
            hint="mesh-motion play --from-journal replays the other steps, and plot draws its results",
        )
    metric = metric or spec.settings.quality_metric
    pair = pair_of(mesh.points, mesh.cells, mesh.points, points, steps=(0, step), metric=metric)
    return MeshPair(label_of(folder), metric, *pair, _titles(0, step), _enrichment(folder, step, points.shape[1]))


def _stored_state(folder: Path, files: PosixFileSystem) -> tuple[int, Floats] | None:
    """The stored step and its coordinates, by global id; the session may be live, so a mismatch is read again."""
    for left in reversed(range(_TRIES)):
        try:
            return read_stored_state(folder, files, read_ledger(folder, files))
        except DataLoss:
            if not left:
                raise
    return None


def _enrichment(folder: Path, step: int, dimension: int) -> Floats:
    """(k, d) where enrichment functions were added in a step, by its last Move."""
    move = last_event(folder, {"moved"}, step) or {}
    places = move.get("enrichment_points", [])
    return np.array(places, dtype=np.float64).reshape(len(places), dimension)


# --- played cases ----------------------------------------------------------------------------------------------------


def _played_pair(folder: Path, metric: str | None, first: int | None, last: int | None) -> MeshPair:
    """The meshes of a run that ``mesh-motion play`` wrote to a folder."""
    of_faces = metric in FACE_METRICS
    run = read_played(folder, None if of_faces else metric)
    series = _series(folder)
    written = [i for i, step in enumerate(run.step) if int(step) in series and step > (first or 0)]
    note = ""
    if last is None:
        if not written:
            raise InvalidInput(f"{folder}: the series has no step after {first or 0}", hint="play writes mesh.pvd")
        order = -np.nan_to_num(run.columns["non_orthogonality"]) if of_faces else run.columns["actual_min"]
        last = int(run.step[min(written, key=lambda i: float(order[i]))])
        note = ("the least orthogonal" if of_faces else "the worst") if len(written) > 1 else ""
    opening = read_mesh(_file(series, 0, folder))
    steps = (first or 0, last)
    points = [read_mesh(_file(series, step, folder)).points for step in steps]
    metric = metric or run.metric
    pair = pair_of(opening.points, opening.cell_table, *points, steps=steps, metric=metric)
    return MeshPair(run.label, metric, *pair, _titles(*steps, note))


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
