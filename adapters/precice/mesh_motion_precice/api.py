"""The part of preCICE 3 that is used: the signatures of its Python bindings (pyprecice 3.0 to 3.4)."""

from __future__ import annotations

import importlib
import os
from typing import Any, Protocol

import numpy as np
from mesh_motion_client import InvalidInput, Unavailable
from numpy.typing import NDArray

__all__ = ["Coupling", "connect_precice"]

#: Environment variables in which launchers of MPI write the number of processes.
_RANKS = ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE")


class Coupling(Protocol):
    """The part of ``precice.Participant`` that is used here."""

    def get_mesh_dimensions(self, mesh_name: str) -> int:
        """2 or 3."""

    def set_mesh_vertices(self, mesh_name: str, positions: NDArray[np.float64]) -> NDArray[np.int32]:
        """(n,) vertex numbers of the positions (n, d); before ``initialize``."""

    def get_data_dimensions(self, mesh_name: str, data_name: str) -> int:
        """1 for a scalar, 2 or 3 for a vector."""

    def requires_mesh_connectivity_for(self, mesh_name: str) -> bool:
        """True if a mapping uses the edges, triangles or tetrahedra of a provided mesh."""

    def set_mesh_edges(self, mesh_name: str, vertices: NDArray[np.int32]) -> None:
        """Vertex numbers (e, 2); before ``initialize``."""

    def set_mesh_triangle(
        self, mesh_name: str, first_vertex_id: int, second_vertex_id: int, third_vertex_id: int
    ) -> None:
        """Vertex numbers; before ``initialize``."""

    def set_mesh_triangles(self, mesh_name: str, vertices: NDArray[np.int32]) -> None:
        """Vertex numbers (t, 3), of a mesh in three dimensions; before ``initialize``."""

    def set_mesh_tetrahedra(self, mesh_name: str, vertices: NDArray[np.int32]) -> None:
        """Vertex numbers (t, 4); before ``initialize``."""

    def set_mesh_access_region(self, mesh_name: str, bounding_box: NDArray[np.float64]) -> None:
        """Choose the part of a received mesh inside a box (2 d,): smallest and largest coordinate of each axis."""

    def get_mesh_vertex_ids_and_coordinates(self, mesh_name: str) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
        """(m,) vertex numbers and (m, d) coordinates of a received mesh; after ``initialize``."""

    def requires_initial_data(self) -> bool:
        """True if data must be written before ``initialize``."""

    def initialize(self) -> None:
        """Connect to the other participants and exchange the meshes."""

    def is_coupling_ongoing(self) -> bool:
        """True if there is a window to compute."""

    def get_max_time_step_size(self) -> float:
        """Remaining time of the window."""

    def requires_writing_checkpoint(self) -> bool:
        """True if the state must be kept: an implicit window begins."""

    def requires_reading_checkpoint(self) -> bool:
        """True if the kept state must be restored: the window is computed again."""

    def is_time_window_complete(self) -> bool:
        """True if the last ``advance`` completed a window."""

    def read_data(
        self, mesh_name: str, data_name: str, vertex_ids: NDArray[np.int32], relative_read_time: float
    ) -> NDArray[np.float64]:
        """(m, d) values at that time after the present one."""

    def write_data(
        self, mesh_name: str, data_name: str, vertex_ids: NDArray[np.int32], values: NDArray[np.float64]
    ) -> None:
        """Values (m, d) at the end of the step that ``advance`` ends next."""

    def advance(self, computed_timestep_length: float) -> None:
        """End a step; at the end of a window, exchange data."""

    def finalize(self) -> None:
        """End the coupling."""


def connect_precice(participant: str, config: str) -> Coupling:
    """The participant of that name, alone (one process).

    Raises
    ------
    Unavailable
        preCICE's Python bindings are not installed, or of another major version.
    InvalidInput
        A launcher of MPI started several processes.
    RuntimeError
        preCICE's error: its configuration cannot be used.
    """
    ranks = max(int(os.environ.get(name) or 1) for name in _RANKS)
    if ranks > 1:
        raise InvalidInput(
            f"{participant} is one process, got {ranks} ranks",
            hint="start it without mpirun; the server computes on all cores, and the solvers may have as many ranks",
        )
    hint = "install libprecice 3 (precice.org), then: pip install 'pyprecice>=3,<4'"
    try:
        precice: Any = importlib.import_module("precice")
    except ImportError as error:
        raise Unavailable(f"preCICE's Python bindings cannot be imported: {error}", hint=hint) from None
    if not hasattr(precice, "Participant"):
        raise Unavailable("the module precice has no Participant: version 3 of the bindings is needed", hint=hint)
    coupling: Coupling = precice.Participant(participant, config, 0, 1)
    return coupling
