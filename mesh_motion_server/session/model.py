"""What a session needs of the numerics: something that moves the mesh and judges it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.numerics.cells import CellTable
from mesh_motion_server.numerics.method import Method
from mesh_motion_server.numerics.roles import Patch

__all__ = ["Model", "ModelBuilder", "build_motion_model", "check_basis"]


class Model(Protocol):
    """:class:`mesh_motion_server.numerics.motion.MotionModel`, as far as a session uses it."""

    @property
    def method(self) -> Method:
        """With both radii filled in."""
        ...

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the mesh check noticed."""
        ...

    def summary(self, points: NDArray[np.float64]) -> Any:
        """QualitySummary of the mesh with its nodes at ``points`` (n, d)."""
        ...

    def move(self, committed: NDArray[np.float64], targets: NDArray[np.float64], factors: Any) -> Any:
        """Motion that takes the moving nodes from the committed positions (n, d) to ``targets`` (k, d)."""
        ...


ModelBuilder = Callable[[NDArray[np.float64], CellTable, Mapping[str, Patch], Method], Model]


def build_motion_model(
    points: NDArray[np.float64], cells: CellTable, patches: Mapping[str, Patch], method: Method
) -> Model:
    """The numerics' model of a mesh."""
    # imported here: the compiled kernels take a second to load, and whoever only lists sessions needs none
    from mesh_motion_server.numerics.motion import MotionModel  # noqa: PLC0415

    return MotionModel.build(points, cells, patches, method)


def check_basis(name: str) -> None:
    """Raise InvalidInput unless the numerics know the basis and can use it."""
    # imported here for the same reason
    from mesh_motion_server.numerics.kernels import basis_named  # noqa: PLC0415

    basis_named(name)
