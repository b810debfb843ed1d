"""Display in a notebook: a few lines about an object, its picture, and the progress of a loop.

matplotlib (the extra ``plot``), PyVista and tqdm are imported only when they are needed, so that a solver's environment
stays small. PyVista draws a 3D mesh if it is installed, otherwise matplotlib.
"""

from __future__ import annotations

import html
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from mesh_motion_client.exchange import optional_package

if TYPE_CHECKING:
    from mesh_motion_client.mesh import Mesh

__all__ = ["Described", "draw", "progress"]

Value = TypeVar("Value")
Floats = NDArray[np.float64]

#: The facets of each 3D cell type, in its node order; cells of a 2D mesh are drawn themselves.
_FACETS: Mapping[str, Sequence[Sequence[int]]] = {
    "tetra": ((0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)),
    "pyramid": ((0, 3, 2, 1), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)),
    "wedge": ((0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
    "hexahedron": ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
}
#: Number of worst cells that are marked.
_MARKED = 10


class Described(ABC):
    """An object that shows itself by a few lines, on a terminal and in a notebook."""

    @abstractmethod
    def description(self) -> list[str]:
        """The lines; the first one names the object."""

    def __repr__(self) -> str:
        return "\n  ".join(self.description())

    def _repr_html_(self) -> str:
        head, *lines = map(html.escape, self.description())
        return f"<strong>{head}</strong><pre>" + "\n".join(lines) + "</pre>"


def progress(steps: Sequence[Value], what: str = "steps") -> Iterator[Value]:
    """Iterate over steps and show the progress: with tqdm if it is installed, else in one line that is overwritten.

    Examples
    --------
    >>> for step in progress(range(1, 4), "flag"):  # doctest: +SKIP
    ...     session.move(motion(step))
    ...     session.commit()
    """
    if find_spec("tqdm"):
        yield from import_module("tqdm.auto").tqdm(steps, desc=what)
        return
    for done, step in enumerate(steps, start=1):
        yield step
        print(f"\r{what}: {done} of {len(steps)}", end="\n" if done == len(steps) else "", flush=True)  # noqa: T201


def draw(mesh: Mesh, points: Floats, title: str, worst: Sequence[Mapping[str, Any]] = ()) -> Any:
    """Draw the mesh at coordinates (n, d), coloured by the displacement of each facet; worst cells are marked.

    In 3D the moving patches are drawn; without moving patches, the whole boundary.

    Returns
    -------
    matplotlib Figure or pyvista Plotter
        The notebook shows it.
    """
    facets = _plane_cells(mesh) if mesh.dimension == 2 else _boundary(mesh)
    moved = np.linalg.norm(points - mesh.points, axis=1)
    far = np.array([moved[facet].mean() for facet in facets])
    places = np.array([cell["centre"] for cell in worst[:_MARKED]]).reshape(-1, mesh.dimension)
    if mesh.dimension == 3 and find_spec("pyvista"):
        return _with_pyvista(points, facets, far, places, title)
    optional_package("matplotlib")
    return import_module("mesh_motion_client.picture").picture(points, facets, far, places, title)


def _plane_cells(mesh: Mesh) -> list[NDArray[np.integer]]:
    """The cells as rows of nodes."""
    return [row for nodes in mesh.cells.values() for row in nodes]


def _boundary(mesh: Mesh) -> list[NDArray[np.integer]]:
    """The facets that belong to one cell only, as rows of nodes; those of the moving patches, if there are any."""
    found: dict[int, list[NDArray[np.integer]]] = {}
    for name, nodes in mesh.cells.items():
        for facet in _FACETS.get(name, ()):
            found.setdefault(len(facet), []).append(nodes[:, facet])
    alone: list[NDArray[np.integer]] = []
    for blocks in found.values():
        rows = np.concatenate(blocks)
        _, first, count = np.unique(np.sort(rows, axis=1), axis=0, return_index=True, return_counts=True)
        alone += list(rows[first[count == 1]])
    moving = [patch.nodes for patch in mesh.patches.values() if patch.role == "moving"]
    seen = np.isin(np.arange(len(mesh.points)), np.concatenate(moving)) if moving else np.ones(len(mesh.points), bool)
    return [facet for facet in alone if seen[facet].all()]


def _with_pyvista(points: Floats, facets: list[Any], far: Floats, places: Floats, title: str) -> Any:
    pyvista = optional_package("pyvista")
    surface = pyvista.PolyData(points, np.concatenate([np.r_[len(facet), facet] for facet in facets]))
    surface.cell_data["moved by"] = far
    plotter = pyvista.Plotter()
    plotter.add_mesh(surface, scalars="moved by", cmap="viridis", show_edges=True)
    if len(places):
        plotter.add_points(places, color="red", point_size=10.0, render_points_as_spheres=True)
    plotter.add_title(title, font_size=10)
    return plotter
