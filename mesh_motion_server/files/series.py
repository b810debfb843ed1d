"""The time series of a run, in the format of its choice."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.files.vtkhdf import VtkHdfSeries
from mesh_motion_server.files.vtu import VtuSeries
from mesh_motion_server.numerics.mesh.cells import CellTable

__all__ = ["SERIES_FORMATS", "Series", "open_series"]

Data = Mapping[str, NDArray[np.generic]]


class Series(Protocol):
    """Grids of the same cells at one time after the other."""

    def write(
        self,
        time: float,
        points: NDArray[np.float64],
        cells: CellTable,
        *,
        point_data: Data | None = None,
        cell_data: Data | None = None,
    ) -> Path:
        """Add the grid of one time and return its file."""

    def close(self) -> None:
        """End the series."""


#: Called with the folder, the stem of the files and the number of times.
SERIES_FORMATS: dict[str, Callable[[Path, str, int], Series]] = {
    "vtu": lambda folder, name, _: VtuSeries(folder, name),
    "vtkhdf": VtkHdfSeries,
}


@contextmanager
def open_series(format_name: str, folder: Path, name: str, times: int) -> Iterator[Series]:
    """A series of at most ``times`` times in a folder; closed at the end of the block."""
    series = SERIES_FORMATS[format_name](folder, name, times)
    try:
        yield series
    finally:
        series.close()
