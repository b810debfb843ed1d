"""The time series of a run, in the format of its choice."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.errors import InvalidInput
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


def _vtkhdf(folder: Path, name: str, times: int, written: Sequence[float]) -> Series:
    if written:
        raise InvalidInput("a vtkhdf series cannot be resumed", hint="play again from the beginning, or with vtu")
    return VtkHdfSeries(folder, name, times)


#: Called with the folder, the stem of the files, the number of times and those that were written before.
SERIES_FORMATS: dict[str, Callable[[Path, str, int, Sequence[float]], Series]] = {
    "vtu": lambda folder, name, _, written: VtuSeries(folder, name, written),
    "vtkhdf": _vtkhdf,
}


@contextmanager
def open_series(
    format_name: str, folder: Path, name: str, times: int, written: Sequence[float] = ()
) -> Iterator[Series]:
    """A series of at most ``times`` times in a folder, behind those ``written``; closed at the end of the block.

    Raises
    ------
    InvalidInput
        If the format cannot go on behind what was written.
    """
    series = SERIES_FORMATS[format_name](folder, name, times, written)
    try:
        yield series
    finally:
        series.close()
