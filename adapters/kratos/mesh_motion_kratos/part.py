"""A Kratos model part as arrays: the interface that the participant needs, and the model part itself.

Nodes are rows 0 … n - 1, ascending by Kratos' number. ``MESH_DISPLACEMENT`` counts from the initial coordinates.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from mesh_motion_kratos.errors import PartError

__all__ = ["CELL_TYPES", "KratosPart", "MovingPart"]

#: (dimension of the element, its nodes) → the protocol's cell type; Kratos' order of the nodes is the protocol's.
CELL_TYPES = {
    (2, 3): "triangle",
    (2, 4): "quad",
    (3, 4): "tetra",
    (3, 5): "pyramid",
    (3, 6): "wedge",
    (3, 8): "hexahedron",
}


class MovingPart(Protocol):
    """A part that moves: the interface that the participant needs.

    Attributes
    ----------
    node_ids : (n,) int64 array
        The numbers that messages name, ascending.
    cells : dict
        Cell type → (m, nodes of the type) int64 array of rows.
    cell_ids : dict
        Cell type → (m,) int64 array: the numbers that messages name.
    """

    node_ids: NDArray[np.int64]
    cells: Mapping[str, NDArray[np.int64]]
    cell_ids: Mapping[str, NDArray[np.int64]]

    def initial_points(self) -> NDArray[np.float64]:
        """(n, d) coordinates from which displacements count."""

    def current_points(self) -> NDArray[np.float64]:
        """(n, d) present coordinates of the nodes."""

    def prescribed(self) -> NDArray[np.bool_]:
        """(n, d) bool array: True for each given component of a node's displacement."""

    def displacements(self) -> NDArray[np.float64]:
        """(n, d) displacements since the initial coordinates, including the given ones."""

    def set_displacements(self, displacements: NDArray[np.float64]) -> None:
        """Set the (n, d) displacements since the initial coordinates."""

    def rows_of(self, name: str) -> NDArray[np.int64]:
        """Rows of the nodes of a sub part.

        Raises
        ------
        PartError
            There is no sub part of that name.
        """


class KratosPart:
    """A ``KratosMultiphysics.ModelPart`` whose nodes have MESH_DISPLACEMENT.

    Parameters
    ----------
    model_part : KratosMultiphysics.ModelPart
    dimension : {2, 3}
        In 2D x and y are moved, z does not change.

    Raises
    ------
    PartError
        No elements, an element whose type is not in :data:`CELL_TYPES`, or one of another dimension.
    """

    def __init__(self, model_part: Any, dimension: int) -> None:
        import KratosMultiphysics  # noqa: PLC0415  (the package can be looked at without Kratos)

        self._kratos = KratosMultiphysics
        self._part = model_part
        self._dimension = dimension
        names = (KratosMultiphysics.MESH_DISPLACEMENT_X, KratosMultiphysics.MESH_DISPLACEMENT_Y)
        self._components = (*names, KratosMultiphysics.MESH_DISPLACEMENT_Z)[:dimension]
        self.node_ids = np.array([node.Id for node in model_part.Nodes], dtype=np.int64)
        self.cells: Mapping[str, NDArray[np.int64]]
        self.cell_ids: Mapping[str, NDArray[np.int64]]
        self.cells, self.cell_ids = self._read_cells()

    def initial_points(self) -> NDArray[np.float64]:
        """(n, d) initial coordinates, mesh length unit."""
        return self._rows(self._kratos.VariableUtils().GetInitialPositionsVector(self._part.Nodes, self._dimension))

    def current_points(self) -> NDArray[np.float64]:
        """(n, d) present coordinates, mesh length unit."""
        return self._rows(self._kratos.VariableUtils().GetCurrentPositionsVector(self._part.Nodes, self._dimension))

    def prescribed(self) -> NDArray[np.bool_]:
        """(n, d) bool array: True for each fixed component of MESH_DISPLACEMENT."""
        return np.array([[node.IsFixed(name) for name in self._components] for node in self._part.Nodes], dtype=bool)

    def displacements(self) -> NDArray[np.float64]:
        """(n, d) MESH_DISPLACEMENT of the present step."""
        return self._rows(self._vector(self._dimension))

    def set_displacements(self, displacements: NDArray[np.float64]) -> None:
        """Set MESH_DISPLACEMENT of the present step, (n, d) array."""
        values = displacements
        if self._dimension == 2:
            values = np.array(self._vector(3)).reshape(-1, 3)
            values[:, :2] = displacements
        vector = self._kratos.Vector(np.ascontiguousarray(values).reshape(-1))
        self._kratos.VariableUtils().SetSolutionStepValuesVector(
            self._part.Nodes, self._kratos.MESH_DISPLACEMENT, vector, 0
        )

    def rows_of(self, name: str) -> NDArray[np.int64]:
        """Rows of the nodes of a sub model part; ``outer.inner`` names one within another.

        Raises
        ------
        PartError
            There is no sub part of that name, or one of its nodes does not belong to the part.
        """
        if not self._part.HasSubModelPart(name):
            known = ", ".join(part.Name for part in self._part.SubModelParts) or "none"
            raise PartError(f'model part "{self._part.Name}" has no sub model part "{name}"', f"it has: {known}")
        ids = np.array([node.Id for node in self._part.GetSubModelPart(name).Nodes], dtype=np.int64)
        return np.searchsorted(self.node_ids, ids)

    def _vector(self, dimension: int) -> Any:
        return self._kratos.VariableUtils().GetSolutionStepValuesVector(
            self._part.Nodes, self._kratos.MESH_DISPLACEMENT, 0, dimension
        )

    def _rows(self, vector: Any) -> NDArray[np.float64]:
        return np.array(vector, dtype=np.float64).reshape(-1, self._dimension)

    def _read_cells(self) -> tuple[dict[str, NDArray[np.int64]], dict[str, NDArray[np.int64]]]:
        """Cells as rows of nodes, and Kratos' element numbers, by cell type."""
        nodes: dict[str, list[list[int]]] = {}
        ids: dict[str, list[int]] = {}
        for element in self._part.Elements:
            geometry = element.GetGeometry()
            shape = geometry.LocalSpaceDimension(), geometry.PointsNumber()
            name = CELL_TYPES.get(shape)
            if name is None or shape[0] != self._dimension:
                raise PartError(
                    f"element {element.Id} has {shape[1]} nodes and dimension {shape[0]}",
                    f"linear elements of dimension {self._dimension} can be moved",
                )
            nodes.setdefault(name, []).append([node.Id for node in geometry])
            ids.setdefault(name, []).append(element.Id)
        if not nodes:
            raise PartError(f'model part "{self._part.Name}" has no elements')
        rows = {name: np.searchsorted(self.node_ids, np.array(cells)) for name, cells in nodes.items()}
        return rows, {name: np.array(numbers, dtype=np.int64) for name, numbers in ids.items()}
