"""IDWarp's inverse distance weighting, built in memory; runs in the Python of an environment that has IDWarp.

Options are IDWarp's defaults: the fast summation has a relative error of 5e-4. IDWarp supports meshes in 3D only.
"""

from __future__ import annotations

import numpy as np
from idwarp import USMesh  # type: ignore[import-not-found, unused-ignore]
from numpy.typing import NDArray

from benchmarks.peers.task import Task

__all__ = ["IDWarpMover"]

Ints = NDArray[np.integer]

#: Local nodes of the facets, in the node order of VTK.
_FACETS = {
    "tetra": ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)),
    "hexahedron": ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
}


class _InMemory(USMesh):  # type: ignore[misc, unused-ignore]
    """A mesh of given nodes; replaces a reader of OpenFOAM's files, which makes the same call."""

    def __init__(self, points: NDArray[np.float64]) -> None:
        self.points = points
        super().__init__({"gridFile": "", "fileType": "OpenFOAM", "symmetryPlanes": []})

    def _readOFGrid(self, _case: str) -> None:
        self.warp.createcommongrid(self.points.T)

    def printOptions(self) -> None:
        """Do nothing, so that standard output does not change."""


class IDWarpMover:
    """IDWarp's motion of the reference mesh.

    Parameters
    ----------
    task : Task
        In three dimensions.
    """

    def __init__(self, task: Task) -> None:
        if task.points.shape[1] != 3:
            raise ValueError("IDWarp moves meshes in space only")
        self.task = task
        self.nodes = np.union1d(task.moving, task.fixed)
        self.mesh = _InMemory(np.ascontiguousarray(task.points))
        facets = [facet for name, cells in task.cells.items() for facet in _boundary(cells, _FACETS[name], self.nodes)]
        local = np.searchsorted(self.nodes, np.concatenate([facet.ravel() for facet in facets]))
        sizes = np.concatenate([np.full(len(facet), facet.shape[1]) for facet in facets])
        self.mesh.setSurfaceDefinition(task.points[self.nodes], local, sizes)

    def move(self, step: int) -> NDArray[np.float64]:
        """Positions after a step."""
        positions = self.task.points[self.nodes].copy()
        positions[np.searchsorted(self.nodes, self.task.moving)] = self.task.targets(step)
        self.mesh.setSurfaceCoordinates(positions)
        self.mesh.warpMesh()
        moved: NDArray[np.float64] = np.asarray(self.mesh.getWarpGrid()).reshape(-1, 3)
        return moved

    def cotangent(self, weights: NDArray[np.float64]) -> NDArray[np.float64]:
        """(k, 3) Jᵀ w: weights of the moving nodes' positions from (n, 3) weights of all nodes, at the last step."""
        self.mesh.warpDeriv(np.ascontiguousarray(weights).ravel(), solverVec=False)
        counted: NDArray[np.float64] = np.asarray(self.mesh.getdXs()).reshape(-1, 3)
        return counted[np.searchsorted(self.nodes, self.task.moving)]


def _boundary(cells: Ints, facets: tuple[tuple[int, ...], ...], nodes: Ints) -> list[Ints]:
    """The facets (f, k) that belong to one cell only and have all their nodes among those of the boundary."""
    held = np.zeros(int(cells.max()) + 1, dtype=bool)
    held[nodes[nodes < len(held)]] = True
    found = np.concatenate([cells[:, facet][held[cells[:, facet]].all(axis=1)] for facet in facets])
    _, first, count = np.unique(np.sort(found, axis=1), axis=0, return_index=True, return_counts=True)
    return [found[first[count == 1]]]
