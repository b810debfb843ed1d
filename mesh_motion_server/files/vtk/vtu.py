"""Results for ParaView: VTK's XML unstructured grids with raw appended data, and ``.pvd`` collections of them.

Arrays are written as in memory, after an 8-byte length each. Cells keep their node order: VTK measures positive volumes
for this order, also for wedges (older VTK documents say otherwise; a test checks it with VTK).

https://docs.vtk.org/en/latest/design_documents/VTKFileFormats.html
"""

import re
from collections.abc import Mapping
from html import escape  # xml.sax.saxutils has the same function, but imports network modules
from pathlib import Path
from typing import BinaryIO

import numpy as np
from mesh_motion_numerics.arrays import Floats
from mesh_motion_numerics.mesh.cells import CellTable
from numpy.typing import NDArray

from mesh_motion_server.files.replace import replacing

Data = Mapping[str, NDArray[np.generic]]

#: Characters that XML cannot contain, escaped or not.
_NOT_IN_XML = re.compile("[^\\t\\n\\r\\x20-\\ud7ff\\ue000-\\ufffd\\U00010000-\\U0010ffff]")

_VTK_NAMES = {"f8": "Float64", "f4": "Float32", "i8": "Int64", "i4": "Int32", "u1": "UInt8", "i1": "Int8"}


def write_vtu(
    path: Path | str, points: Floats, cells: CellTable, *, point_data: Data | None = None, cell_data: Data | None = None
) -> None:
    """Write one grid, replacing the file in one step.

    Parameters
    ----------
    points : (n, d) array
        For d < 3, zeros are added, because VTK's points have three coordinates.
    point_data, cell_data : dict of str to (n,) | (n, d), (m,) | (m, d) arrays, optional
        Vectors with d = 2 get a third component of zero. The array ``cell`` has each cell's row in its type, as used in
        messages.
    """
    body = _Appended()
    rows = np.concatenate([np.arange(len(block), dtype=np.int64) for block in cells])
    point_lines = [body.array(name, _three_components(values)) for name, values in (point_data or {}).items()]
    cell_lines = [
        body.array(name, _three_components(values)) for name, values in {**(cell_data or {}), "cell": rows}.items()
    ]
    geometry = [body.array("Points", _three_components(points, vector=True))]
    structure = [body.array(name, values) for name, values in _topology(cells).items()]
    sections = (("PointData", point_lines), ("CellData", cell_lines), ("Points", geometry), ("Cells", structure))
    head = "\n".join(
        [
            '<?xml version="1.0"?>',
            '<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" header_type="UInt64">',
            f'<UnstructuredGrid><Piece NumberOfPoints="{len(points)}" NumberOfCells="{len(cells)}">',
            *(f"<{name}>\n" + "\n".join(lines) + f"\n</{name}>" for name, lines in sections),
            "</Piece></UnstructuredGrid>",
            '<AppendedData encoding="raw">\n_',
        ]
    )
    with replacing(Path(path)) as file:
        file.write(head.encode())
        body.write(file)
        file.write(b"\n</AppendedData></VTKFile>\n")


class VtuSeries:
    """A time series in a folder: ``<name>_0000.vtu``, … and ``<name>.pvd``, which lists the files written so far.

    Parameters
    ----------
    folder : path
        Exists.
    name : str
        Stem of all files.
    """

    def __init__(self, folder: Path, name: str) -> None:
        self._folder = folder
        self._name = name
        self._entries: list[tuple[float, str]] = []

    def write(
        self,
        time: float,
        points: Floats,
        cells: CellTable,
        *,
        point_data: Data | None = None,
        cell_data: Data | None = None,
    ) -> Path:
        """Add the grid of one time and return its file."""
        path = self._folder / f"{self._name}_{len(self._entries):04d}.vtu"
        write_vtu(path, points, cells, point_data=point_data, cell_data=cell_data)
        self._entries.append((time, path.name))
        self._write_collection()
        return path

    def _write_collection(self) -> None:
        rows = "\n".join(f'<DataSet timestep="{time:.17g}" file="{escape(name)}"/>' for time, name in self._entries)
        head = '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1"><Collection>'
        text = f"{head}\n{rows}\n</Collection></VTKFile>\n"
        with replacing(self._folder / f"{self._name}.pvd") as file:
            file.write(text.encode())


class _Appended:
    """Arrays of the appended section: declare them one after the other, then write them in this order."""

    def __init__(self) -> None:
        self._arrays: list[NDArray[np.generic]] = []
        self._offset = 0

    def array(self, name: str, values: NDArray[np.generic]) -> str:
        """Declare an array and return its XML element."""
        little = np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("<"))
        element = (
            f'<DataArray type="{_VTK_NAMES[little.dtype.str[1:]]}" Name="{escape(_NOT_IN_XML.sub("�", name))}" '
            f'NumberOfComponents="{1 if little.ndim == 1 else little.shape[1]}" '
            f'format="appended" offset="{self._offset}"/>'
        )
        self._arrays.append(little)
        self._offset += 8 + little.nbytes
        return element

    def write(self, file: BinaryIO) -> None:
        """Write all arrays, each after its length."""
        for values in self._arrays:
            file.write(np.array(values.nbytes, dtype="<u8").tobytes())
            file.write(values.data if values.size else b"")


def _three_components(values: NDArray[np.generic], *, vector: bool = False) -> NDArray[np.generic]:
    """Extend vectors to three components; convert scalars and booleans to types that VTK knows."""
    if values.dtype == np.bool_:
        values = values.astype(np.uint8)
    if values.ndim == 2 and (vector or values.shape[1] == 2):
        return np.pad(values, ((0, 0), (0, 3 - values.shape[1])))
    return values


def _topology(cells: CellTable) -> dict[str, NDArray[np.generic]]:
    """VTK's connectivity, offsets (ends of the cells) and types."""
    ends = np.cumsum(np.concatenate([np.full(len(block), block.type.n_nodes, dtype=np.int64) for block in cells]))
    types = np.concatenate([np.full(len(block), block.type.vtk, dtype=np.uint8) for block in cells])
    return {"connectivity": np.concatenate([block.nodes.ravel() for block in cells]), "offsets": ends, "types": types}
