"""The quality after many steps, without moving the mesh in between (thesis (3.8)–(3.12)).

Each step i has its own displacement field S^i, defined on the mesh after the earlier steps. The ratio of sizes
over all steps telescopes, so that in one dimension ``f = Π_i (1 + ∇S^i)`` (thesis (3.12)). In more dimensions the
factors are matrices, and their order matters: ``B = (I + ∇S^n) … (I + ∇S^1) (I + ∇S^0)``, the latest on the left.

The thesis leaves open where ∇S^i is taken. It must be the *same piece of material* in every step: the cell's centre at
the start, moved by the fields (``x^(i+1) = x^i + S^i(x^i)``, thesis (3.2), for one point of each cell instead of all
nodes). By the chain rule B is then exactly the gradient of the whole motion, and a prediction over many steps has the
same error as a prediction over one step: errors do not accumulate.

:class:`AccumulatedGradients` does it step by step, as in a time-dependent computation; :class:`ComposedField` and
:func:`predict_many_steps` do it for a list of fields with any of the predictors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.quality.metrics import CellQuality
from mesh_motion_protocol.errors import InvalidInput
from numpy.typing import NDArray

from docs.studies.thesis._predictors import (
    DisplacementField,
    centre_positions,
    predict,
    transformed_quality,
)

__all__ = ["AccumulatedGradients", "ComposedField", "predict_many_steps"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class AccumulatedGradients:
    """The deformation gradient of every followed point over the steps so far, thesis (3.12).

    Attributes
    ----------
    places : (k, d) array, mesh length unit
        Present positions of the points.
    deformation : (k, d, d) array
        B = Π (I + ∇S^i), the latest factor on the left.
    """

    places: Floats
    deformation: Floats

    @classmethod
    def at(cls, points: Floats) -> Self:
        """Start at the points (k, d), without any step."""
        return cls(points, np.broadcast_to(np.eye(points.shape[1]), (len(points), *(points.shape[1],) * 2)))

    @classmethod
    def of_cells(cls, points: Floats, cells: CellTable) -> Self:
        """Follow the centres of all cells of the mesh with its nodes at ``points`` (n, d)."""
        return cls.at(centre_positions(points, cells))

    def advance(self, field: DisplacementField) -> AccumulatedGradients:
        """Add one step: one factor of (3.12) for each point, and its new position (3.2)."""
        factor = np.eye(self.places.shape[1]) + field.gradient(self.places)
        deformation = np.einsum("nij,njk->nik", factor, self.deformation)
        return AccumulatedGradients(self.places + field.displacement(self.places), deformation)

    def quality(self, points: Floats, cells: CellTable, reference_sizes: Floats) -> CellQuality:
        """Predicted quality of all cells: A^(n+1) = B A^0 (thesis (3.20) with the B of all steps).

        Parameters
        ----------
        points : (n, d) array, mesh length unit
            Positions of the nodes at the start of the accumulation (:meth:`of_cells`).
        reference_sizes : (m,) array
        """
        return transformed_quality(points, cells, reference_sizes, self.deformation - np.eye(cells.dimension))


@dataclass(frozen=True)
class ComposedField:
    """The displacement of several steps, one after the other, as one field at the positions before the first.

    Attributes
    ----------
    steps : sequence of DisplacementField
        Each is defined at the positions after the earlier steps.
    """

    steps: Sequence[DisplacementField]

    def displacement(self, points: Floats) -> Floats:
        """(n, d) total displacement of points (n, d), mesh length unit."""
        moved = points
        for step in self.steps:
            moved = moved + step.displacement(moved)
        return moved - points

    def gradient(self, points: Floats) -> Floats:
        """(n, d, d) gradient of the total displacement: Π (I + ∇S^i) − I."""
        accumulated = AccumulatedGradients.at(points)
        for step in self.steps:
            accumulated = accumulated.advance(step)
        return accumulated.deformation - np.eye(points.shape[1])


def predict_many_steps(
    name: str,
    points: Floats,
    cells: CellTable,
    reference_sizes: Floats,
    steps: Sequence[DisplacementField],
) -> CellQuality:
    """Quality of every cell after all steps, without displacing a node; thesis (3.9) to (3.12).

    Parameters
    ----------
    name : str
        One of :data:`~docs.studies.thesis._predictors.PREDICTORS`; ``"centre-gradient"`` is the thesis'.
    points : (n, d) array, mesh length unit
        Positions before the first step.
    reference_sizes : (m,) array
        From :func:`~mesh_motion_numerics.quality.metrics.reference_sizes`.
    steps : sequence of DisplacementField
        The displacement field of each step, in their order.

    Raises
    ------
    InvalidInput
        Without a step, or on an unknown predictor.
    """
    if not steps:
        raise InvalidInput("expected at least one step, got none")
    return predict(name, points, cells, reference_sizes, ComposedField(tuple(steps)))
