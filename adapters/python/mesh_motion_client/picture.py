"""A picture of the mesh with matplotlib; this module is imported when the first picture is drawn."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from numpy.typing import NDArray

__all__ = ["Picture", "picture"]

Floats = NDArray[np.float64]
Ints = NDArray[np.integer]


class Picture(Figure):
    """A figure that a notebook shows once, with any backend of matplotlib."""

    def _repr_png_(self) -> bytes:
        file = io.BytesIO()
        self.savefig(file, format="png", dpi=90)
        return file.getvalue()


def picture(points: Floats, facets: Sequence[Ints], far: Floats, places: Floats, title: str) -> Picture:
    """Draw facets at coordinates (n, d), coloured by displacements (f,), with marks at places (k, d)."""
    flat = points.shape[1] == 2
    seen = np.concatenate([*(points[facet] for facet in facets), places])
    low, high = seen.min(axis=0), seen.max(axis=0)
    margin = 0.02 * (high - low).max()  # the points of a patch may lie in one plane
    low, high = low - margin, high + margin
    height = 1.5 + 7.0 * min(1.0, float((high - low)[1] / (high - low)[0])) if flat else 4.5
    figure = Picture(figsize=(8.0, height), layout="constrained")
    axes: Any = figure.add_subplot(projection=None if flat else "3d")
    kind = PolyCollection if flat else Poly3DCollection
    cells = kind([points[facet] for facet in facets], edgecolors="#20202060", linewidths=0.3, cmap="viridis")
    cells.set_array(far)
    (axes.add_collection if flat else axes.add_collection3d)(cells)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    figure.suptitle(title, fontsize="small")
    if flat:
        axes.set_aspect("equal")
    else:
        axes.set_zlim(low[2], high[2])
        axes.set_box_aspect(high - low)
    if len(places):
        axes.scatter(*places.T, s=40, facecolors="none", edgecolors="#d9341f", label="worst cells")
        axes.legend(loc="upper right", fontsize="small")
    figure.colorbar(cells, ax=axes, label="moved by", location="bottom" if flat else "right", aspect=40, shrink=0.8)
    return figure
