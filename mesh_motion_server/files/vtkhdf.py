"""Results for ParaView in one file: VTKHDF 2.0, an UnstructuredGrid whose points move and whose cells stay.

The cells are stored once, compressed; every time refers to them (offsets 0) and to rows of its own in ``Points`` and in
the data arrays. These lie in one piece of the file whose place is taken at the beginning and filled step by step: no
index changes while a step is written, and the attribute ``NSteps``, which says how many there are, follows when the
rows lie in the file. So the file can be opened at any moment, also when the writer was killed; it then ends with the
last whole step. Compressing the steps would cost that, and a multiple of the time (docs/files.md has figures).

https://docs.vtk.org/en/latest/vtk_file_formats/vtkhdf_file_format/index.html
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.files.packages import load_h5py
from mesh_motion_server.files.vtk_arrays import three_components, topology
from mesh_motion_server.numerics.mesh.cells import CellTable

__all__ = ["VtkHdfSeries"]

FloatArray = NDArray[np.float64]
Data = Mapping[str, NDArray[np.generic]]

_VERSION = (2, 0)
_CHUNK = 1 << 16


class VtkHdfSeries:
    """A time series in the file ``<name>.vtkhdf`` of a folder.

    Parameters
    ----------
    folder : path
        Exists.
    name : str
        Stem of the file.
    times : int
        How many times will be written at most; the file's size is that of all of them, but what is not written takes
        no place on the disk.

    Raises
    ------
    InvalidInput
        Without h5py.
    """

    def __init__(self, folder: Path, name: str, times: int) -> None:
        self.path = folder / f"{name}.vtkhdf"
        self._h5py = load_h5py(Path(self.path.name))
        self._times = times
        self._written = 0
        self._file: Any = None
        self._rows: dict[str, Any] = {}  # the arrays that every time adds rows to

    def write(
        self,
        time: float,
        points: FloatArray,
        cells: CellTable,
        *,
        point_data: Data | None = None,
        cell_data: Data | None = None,
    ) -> Path:
        """Add the grid of one time, with the cells and the names of arrays of the first one; return the file."""
        arrays = {"Points": three_components(points, vector=True)}
        for group, data in (("PointData", point_data), ("CellData", cell_data)):
            arrays |= {f"{group}/{name}": three_components(values) for name, values in (data or {}).items()}
        if self._file is None:
            self._create(cells, len(points), arrays)
        k = self._written
        for name, values in arrays.items():
            self._rows[name][k * len(values) : (k + 1) * len(values)] = values
        self._file.flush()  # the rows lie in the file before it says that they do
        self._written += 1
        self._tell(time)
        return self.path

    def _tell(self, time: float) -> None:
        """Say that there is one time more; of ``Values`` VTK survives one too few, but not one too many."""
        steps = self._file["VTKHDF/Steps"]
        steps.attrs.modify("NSteps", self._written)
        self._file.flush()
        values = steps["Values"]
        values.resize((self._written,))
        values[-1] = time
        self._file.flush()

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()
            self._file = None

    def _create(self, cells: CellTable, n_points: int, arrays: Data) -> None:
        """Make the file: the cells, and room for the rows of all times."""
        # without a lock ParaView may look at a file that is being written
        self._file = self._h5py.File(self.path, "w", locking=False)
        root = self._file.create_group("VTKHDF")
        root.attrs["Version"] = np.array(_VERSION, dtype=np.int64)
        root.attrs.create("Type", b"UnstructuredGrid", dtype=self._h5py.string_dtype("ascii", len("UnstructuredGrid")))
        grid = topology(cells)
        for name, values in (
            ("Connectivity", grid["connectivity"]),
            ("Offsets", np.concatenate([[0], grid["offsets"]])),
            ("Types", grid["types"]),
        ):
            chunk = (min(len(values), _CHUNK),)
            root.create_dataset(name, data=values, chunks=chunk, compression="gzip", shuffle=True)
        for name, count in (
            ("NumberOfPoints", n_points),
            ("NumberOfCells", len(cells)),
            ("NumberOfConnectivityIds", len(grid["connectivity"])),
        ):
            root.create_dataset(name, data=np.array([count], dtype=np.int64))
        for name, values in arrays.items():
            self._rows[name] = self._room(root, name, values)
        self._create_steps(root, n_points, len(cells), arrays)

    def _room(self, root: Any, name: str, values: NDArray[np.generic]) -> Any:
        """An array for the rows of all times, whose place in the file is fixed now."""
        h5 = self._h5py
        plan, links = h5.h5p.create(h5.h5p.DATASET_CREATE), h5.h5p.create(h5.h5p.LINK_CREATE)
        plan.set_alloc_time(h5.h5d.ALLOC_TIME_EARLY)
        plan.set_fill_time(h5.h5d.FILL_TIME_NEVER)
        links.set_create_intermediate_group(True)
        space = h5.h5s.create_simple((self._times * len(values), *values.shape[1:]))
        kind = h5.h5t.py_create(values.dtype, logical=True)
        return h5.Dataset(h5.h5d.create(root.id, name.encode(), kind, space, plan, links))

    def _create_steps(self, root: Any, n_points: int, n_cells: int, arrays: Data) -> None:
        """The group that says which rows belong to which time."""
        steps = root.create_group("Steps")
        number = np.arange(self._times, dtype=np.int64)
        none = np.zeros(self._times, dtype=np.int64)
        values = {"PartOffsets": none, "NumberOfParts": none + 1}
        values |= {
            "PointOffsets": number * n_points,
            "CellOffsets": none[:, None],
            "ConnectivityIdOffsets": none[:, None],
        }
        for name in arrays:
            group, _, array = name.partition("/")
            if array:
                values[f"{group}Offsets/{array}"] = number * (n_points if group == "PointData" else n_cells)
        for name, content in values.items():
            steps.create_dataset(name, data=content)
        steps.create_dataset("Values", shape=(0,), maxshape=(self._times,), chunks=(self._times,), dtype=np.float64)
        steps.attrs.create("NSteps", 0, dtype=np.int64)
