"""The committed mesh of a stored session for drawing: coordinates, drawn surface, quality of each cell.

Reading changes nothing and takes no lock, so the session may be live: two slots hold the latest states in turn. A state
that is overwritten during reading does not match its digest and is read again. With durability ``replay`` and
``relaxed``, not every committed state is stored: the view shows the last stored one.

Of a mesh of more than :data:`MOST_CELLS` cells only the surroundings of its worst cell are shown in 2D; in 3D it is
always the boundary and the worst cells. Quality is computed for all cells.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mesh_motion_server.errors import InvalidInput, JournalError
from mesh_motion_server.numerics.arrays import Floats, Integers, Marks
from mesh_motion_server.numerics.quality.metrics import cell_quality
from mesh_motion_server.numerics.quality.orientation import oriented_at_rest
from mesh_motion_server.session.journal.files import SLOTS, read_journal, verified_state
from mesh_motion_server.session.journal.filesystem import FileSystem, PosixFileSystem
from mesh_motion_server.session.journal.ledger import Ledger
from mesh_motion_server.session.journal.mesh_store import read_mesh
from mesh_motion_server.session.partitions.merging import merge
from mesh_motion_server.session.partitions.meshes import CellOrigin, MergedMesh
from mesh_motion_server.session.spec import StoredSpec, spec_bytes
from mesh_motion_server.watch.observation.mesh_surface import Surface, cells_surface, sides_surface

__all__ = ["MOST_CELLS", "CellNames", "MeshView", "StoredMesh"]


#: Number of cells or boundary facets that a browser draws without difficulty.
MOST_CELLS = 200_000
#: Maximum and minimum number of cells below the threshold (or the worst) that are shown with all sides in 3D.
_MOST_INNER, _LEAST_INNER = 2000, 60
_TRIES = 4


@dataclass(frozen=True, eq=False)
class CellNames:
    """The clients' names of cells.

    Attributes
    ----------
    kind : (c,) int64 array
        Index of each cell's type in ``types``.
    partition, local : (c,) int64 arrays
    """

    types: tuple[str, ...]
    kind: Integers
    partition: Integers
    local: Integers


@dataclass(frozen=True, eq=False)
class MeshView:
    """A committed state, ready to be drawn.

    Attributes
    ----------
    step : int
        The step of the coordinates.
    committed : int
        The last committed step, which may be later.
    points : (n, d) array, mesh length unit
        Coordinates of all nodes.
    box : (2, d) array, mesh length unit
        Bounding box of the uploaded mesh: it fixes the view, so the motion is visible.
    surface : Surface
        The drawn surface, with node and cell numbers of the whole mesh.
    cells : (c,) int64 array
        The shown cells, ascending.
    names : CellNames
        Names of the shown cells.
    quality : (m,) array
        Quality of all cells, in the session's metric.
    inverted : (m,) bool array
        For all cells, because the metric of a partly inverted cell may be 0 or more.
    whole : bool
        Whether the view has all cells.
    """

    step: int
    committed: int
    dimension: int
    points: Floats
    box: Floats
    surface: Surface
    cells: Integers
    names: CellNames
    quality: Floats
    metric: str
    threshold: float
    inverted: Marks
    whole: bool


class StoredMesh:
    """The mesh of one session; constant data are kept between calls.

    Parameters
    ----------
    folder : Path
        The session's.
    most_bytes : int
        A larger mesh file is not read.

    Raises
    ------
    JournalError
        If no mesh is stored yet, or its files do not verify.
    InvalidInput
        If the mesh takes more than ``most_bytes``, or its cells are with the client.
    """

    def __init__(self, folder: Path, most_bytes: int = 1 << 62, files: FileSystem | None = None) -> None:
        self._folder = folder
        self._files = files or PosixFileSystem()
        self._spec = StoredSpec.from_bytes(spec_bytes(folder))
        self._spec.require_cells()
        foundation = read_journal(folder, self._files).ledger.foundation
        _check_size(folder / "mesh.bin", most_bytes)
        self._mesh = merge(read_mesh(folder / "mesh.bin", self._files, foundation.mesh))
        self._cells, self._sizes = oriented_at_rest(self._mesh.points, self._mesh.cells)
        self._surface: Surface | None = None

    def look(self) -> MeshView:
        """View the last stored state.

        Raises
        ------
        JournalError
            If its files do not verify.
        """
        step, committed, points = self.coordinates()
        method, cells = self._spec.settings, self._cells
        judged = cell_quality(points, cells, self._sizes)
        quality = judged.metric(method.quality_metric)
        ranked = np.where(judged.inverted, np.minimum(quality, 0.0) - 1.0, quality)
        surface, whole = self._drawn(points, ranked, method.quality_threshold)
        shown = np.unique(surface.owners[surface.owners >= 0])
        return MeshView(
            step=step,
            committed=committed,
            dimension=cells.dimension,
            points=points,
            box=np.array([self._mesh.points.min(axis=0), self._mesh.points.max(axis=0)]),
            surface=surface,
            cells=shown,
            names=_names(self._mesh, shown),
            quality=quality,
            metric=method.quality_metric,
            threshold=method.quality_threshold,
            inverted=judged.inverted,
            whole=whole,
        )

    @property
    def mesh(self) -> MergedMesh:
        """The uploaded mesh; its coordinates are the reference."""
        return self._mesh

    def coordinates(self) -> tuple[int, int, Floats]:
        """The last stored step, the last committed step, and the coordinates (n, d) of the stored step.

        Nodes come in canonical order.

        Raises
        ------
        JournalError
            If its files do not verify.
        """
        for left in reversed(range(_TRIES)):
            try:
                ledger = read_journal(self._folder, self._files).ledger
                snapshot = ledger.snapshot
                if snapshot is None:
                    return 0, ledger.step, self._mesh.points
                points = np.empty_like(self._mesh.points)
                points[self._mesh.id_order] = verified_state(self._slot(ledger, snapshot.slot), ledger)
                return snapshot.step, ledger.step, points
            except JournalError:  # overwritten by later commits; an error that persists is real
                if not left:
                    raise
        raise AssertionError("unreachable")

    def _slot(self, ledger: Ledger, slot: int) -> bytes:
        handle = self._files.open(self._folder / SLOTS[slot], writable=False)
        try:
            return self._files.read(handle, ledger.foundation.record_area, ledger.foundation.state_bytes)
        finally:
            self._files.close(handle)

    def _drawn(self, points: Floats, quality: Floats, threshold: float) -> tuple[Surface, bool]:
        """The drawn surface, and whether it is complete; for a 2D mesh that is drawn completely, it never changes.

        ``quality`` (m,) ranks the cells: inverted cells must have lower values than all others.
        """
        cells, flat = self._cells, self._cells.dimension < 3
        whole = len(cells) <= MOST_CELLS
        if flat and whole:
            self._surface = self._surface or cells_surface(cells)
            return self._surface, True
        worst = cells.centres(points, np.array([int(np.argmin(quality))]))[0]
        if flat:
            distances = np.linalg.norm(cells.centres(points, np.arange(len(cells))) - worst, axis=1)
            return cells_surface(cells, np.sort(np.argpartition(distances, MOST_CELLS)[:MOST_CELLS])), False
        distances = np.linalg.norm(points - worst, axis=1)
        return sides_surface(cells, _worst(quality, threshold), MOST_CELLS, distances), whole


def _worst(quality: Floats, threshold: float) -> Integers:
    """Ascending numbers of the cells that are shown with all sides."""
    below = int(np.count_nonzero(quality < threshold))
    count = min(len(quality), max(_LEAST_INNER, min(below, _MOST_INNER)))
    return np.sort(np.argpartition(quality, count - 1)[:count])


def _names(mesh: MergedMesh, cells: Integers) -> CellNames:
    """The names of the cells with these ascending numbers (c,)."""
    kind, partition, local = (np.empty(len(cells), dtype=np.int64) for _ in range(3))
    origins = [origin for origin in mesh.cell_origins if isinstance(origin, CellOrigin)]
    types = tuple(origin.type_name for origin in origins)
    bounds = zip(origins, mesh.cells.offsets, mesh.cells.offsets[1:], strict=False)
    for number, (origin, first, last) in enumerate(bounds):
        here = slice(*np.searchsorted(cells, [first, last]))
        rows = cells[here] - first
        kind[here], partition[here], local[here] = number, origin.partition[rows], origin.local[rows]
    return CellNames(types, kind, partition, local)


def _check_size(path: Path, most: int) -> None:
    try:
        size = path.stat().st_size
    except OSError as error:
        raise JournalError(f"the mesh cannot be read: {error.strerror or error}") from error
    if size > most:
        raise InvalidInput(
            f"the mesh takes {size / 1e6:.0f} MB; drawn are meshes of up to {most / 1e6:.0f} MB",
            hint="draw the fetched coordinates with a program for large meshes, such as ParaView",
        )
