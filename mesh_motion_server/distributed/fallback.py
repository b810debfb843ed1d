"""Computes on this machine while no worker answers, if the operator allows it."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.distributed.evaluator import DistributedEvaluator
from mesh_motion_server.errors import ResourceError
from mesh_motion_server.numerics.interpolation.evaluation import LocalEvaluator
from mesh_motion_server.numerics.interpolation.two_scale.interpolant import AnyInterpolant
from mesh_motion_server.numerics.mesh.cells import CellTable
from mesh_motion_server.numerics.quality.mesh_summary import mesh_summary
from mesh_motion_server.numerics.quality.metrics import CellsAtRest
from mesh_motion_server.numerics.quality.orientation import oriented_at_rest
from mesh_motion_server.numerics.quality.quality_summary import QualitySummary

__all__ = ["LocalWhenAlone"]

Floats = NDArray[np.float64]
_Found = TypeVar("_Found")

#: Seconds until workers that did not answer are tried again.
_PAUSE = 60.0


class LocalWhenAlone:
    """A distributed evaluator and judge that is replaced by a local one for a minute whenever no worker answers.

    Parameters
    ----------
    evaluator : DistributedEvaluator
    points : (n, d) array, mesh length unit
        Reference coordinates.
    cells : CellTable
    pause : float, seconds
    """

    def __init__(
        self, evaluator: DistributedEvaluator, points: Floats, cells: CellTable, *, pause: float = _PAUSE
    ) -> None:
        self._evaluator = evaluator
        self._points = points
        self._cells = cells
        self._pause = pause
        self._alone_until = float("-inf")
        self._local = LocalEvaluator()

    def displacement(self, interpolant: AnyInterpolant, points: Floats) -> Floats:
        """(n, k) values at (n, d) points."""
        return self._first(
            lambda: self._evaluator.displacement(interpolant, points),
            lambda: self._local.displacement(interpolant, points),
        )

    def gradient(self, interpolant: AnyInterpolant, points: Floats) -> Floats:
        """(n, k, d) gradients at (n, d) points."""
        return self._first(
            lambda: self._evaluator.gradient(interpolant, points),
            lambda: self._local.gradient(interpolant, points),
        )

    def summary(self, points: Floats, metric: str) -> QualitySummary:
        """Quality of the mesh with its nodes at ``points`` (n, d)."""
        return self._first(
            lambda: self._evaluator.summary(points, metric),
            lambda: mesh_summary(points, *self._oriented, metric=metric),
        )

    def _first(self, distributed: Callable[[], _Found], local: Callable[[], _Found]) -> _Found:
        if time.monotonic() < self._alone_until:
            return local()
        try:
            return distributed()
        except ResourceError as error:
            if error.code != "UNAVAILABLE":
                raise
            self._alone_until = time.monotonic() + self._pause
            return local()

    @cached_property
    def _oriented(self) -> tuple[CellTable, CellsAtRest]:
        return oriented_at_rest(self._points, self._cells)
