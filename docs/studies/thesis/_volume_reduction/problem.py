"""Input and output of every reduction of the volume nodes (thesis §2.2.1).

A point reduction makes the sums of (2.5) shorter; a volume reduction evaluates them at fewer places. All algorithms
have one calling convention, ``reduce(problem) -> VolumeField``: the input is the data of a boundary's motion, the
output a displacement field that is defined everywhere and also reports where sums were evaluated.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from mesh_motion_protocol.errors import InvalidInput
from numpy.typing import NDArray

__all__ = ["Field", "VolumeDisplacement", "VolumeField", "VolumeProblem"]

Floats = NDArray[np.float64]

#: Displacement (n, d) of points (n, d), mesh length unit.
Field = Callable[[Floats], Floats]


@dataclass(frozen=True, eq=False)
class VolumeProblem:
    """A boundary's motion, and its standard field.

    Attributes
    ----------
    boundary : (nb, d) array, mesh length unit
        Control points: moving, fixed and sliding nodes.
    displacement : (nb, d) array, mesh length unit
    moving : (nb,) bool array
        Which of them have the role ``moving``: the body.
    nodes : (n, d) array, mesh length unit
        The mesh that is to be moved; sizes are chosen for it.
    standard : callable
        Thesis (2.5) with all control points: dear.
    interpolate : callable
        ``interpolate(control_points, values)``: the field (2.1) of other control points, with the same method.
    length : float or None, mesh length unit
        The algorithm's size; None: chosen from the problem.

    Raises
    ------
    InvalidInput
        On shapes that do not fit, or a length that is not positive.
    """

    boundary: Floats
    displacement: Floats
    moving: NDArray[np.bool_]
    nodes: Floats
    standard: Field
    interpolate: Callable[[Floats, Floats], Field]
    length: float | None = None

    def __post_init__(self) -> None:
        if self.displacement.shape != self.boundary.shape or self.moving.shape != self.boundary.shape[:1]:
            raise InvalidInput(
                f"expected displacements of shape {self.boundary.shape} and {len(self.boundary)} marks, "
                f"got {self.displacement.shape} and {self.moving.shape}",
                code="INVALID_ARGUMENT.SHAPE",
            )
        if not self.moving.any():
            raise InvalidInput("a volume reduction needs a moving node", hint="give a patch the role moving")
        if self.length is not None and not (np.isfinite(self.length) and self.length > 0.0):
            raise InvalidInput(f"expected a volume reduction length > 0, got {self.length!r}")

    @property
    def largest(self) -> float:
        """Length of the largest displacement of a control point."""
        return float(np.sqrt(np.max(np.sum(self.displacement**2, axis=1))))

    def reach(self, displacements: float, bodies: float) -> float:
        """The length if it is given; else the larger of multiples of the displacement and of the body's size."""
        if self.length is not None:
            return self.length
        body = float(np.ptp(self.boundary[self.moving], axis=0).max())
        domain = float(np.ptp(self.nodes, axis=0).max())
        return max(displacements * self.largest, bodies * body) or domain


class VolumeDisplacement(NamedTuple):
    """Displacements, and how they were computed.

    Attributes
    ----------
    displacement : (n, d) array, mesh length unit
    evaluated : (n,) bool array
        Points at which sums over control points were evaluated; the others rest, or were interpolated.
    places : int
        Number of all places at which sums were evaluated, including those of a grid.
    control_points : int
        Terms of each sum.
    """

    displacement: Floats
    evaluated: NDArray[np.bool_]
    places: int
    control_points: int


class VolumeField(Protocol):
    """A displacement field that is cheap where the volume is large."""

    def __call__(self, points: Floats) -> VolumeDisplacement:
        """Displacement of points (n, d)."""
        ...
