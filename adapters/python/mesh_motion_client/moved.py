"""The reply to a Move, as users of the client get it: with its mesh, so that it can be drawn."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from mesh_motion_protocol import messages
from mesh_motion_protocol.errors import InvalidInput
from mesh_motion_protocol.headroom import headroom_in_words
from numpy.typing import ArrayLike, NDArray

from mesh_motion_client.display import Described, draw
from mesh_motion_client.exchange import to_pyvista
from mesh_motion_client.mesh import Mesh
from mesh_motion_client.quality import PredictedQuality

if TYPE_CHECKING:
    from mesh_motion_client.session import Session

__all__ = ["Moved"]

#: Number of faces of each cell type, in the order of their swept volumes.
FACES_OF = {"line": 2, "triangle": 3, "quad": 4, "tetra": 4, "hexahedron": 6, "wedge": 5, "pyramid": 5}


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Moved(Described, messages.Moved):
    """A trial; its fields are those of the message.

    Attributes
    ----------
    displacement : (n, d) array, mesh length unit
        Displacement of all nodes of the partition, in the frame of the move.
    quality : PredictedQuality
    mesh : Mesh or None
        None in a session that was resumed.
    velocity : (n, d) array or None
        Velocity of all nodes of the partition, mesh length unit per second, if it was requested.
    swept : (f,) array or None
        The volume that each face sweeps in this step, if it was requested.
    is_total : bool
        Whether displacements count from the reference mesh.
    session : Session or None
        The session that moved.
    """

    quality: PredictedQuality  # type: ignore[assignment]  # what the message's dict holds
    mesh: Mesh | None = None
    is_total: bool = True
    session: Session | None = None

    def description(self) -> list[str]:
        """The step, the quality, the largest displacement, and the warnings."""
        quality, kind = self.quality, self.correction.get("method", "none")
        plain, kept = quality["standard"]["metric"]["min"], quality["corrected"]["metric"]["min"]
        corrected = f", {plain:.3f} without the correction {kind!r}" if kind != "none" else ", not corrected"
        farthest = np.linalg.norm(self.displacement, axis=1).max(initial=0.0)
        return [
            f"Moved: step {self.step}, iteration {self.iteration}, {self.seconds.get('total', 0.0):.3g} s",
            f"{quality['metric']}: minimum {kept:.3f}{corrected}; threshold {quality['threshold']:g}",
            f"{len(self.displacement)} nodes, the farthest moves by {farthest:.4g}",
            *filter(None, [headroom_in_words(self.headroom)]),
            *(f"warning: {text}" for text in self.warnings),
        ]

    def swept_of_cells(self) -> dict[str, NDArray[np.float64]]:
        """Cell type → (m, f) volumes that the faces of each cell sweep outwards in this step.

        Faces come in the order of SPEC.md, section 25; the sum of a row is the change of the cell's volume.

        Raises
        ------
        InvalidInput
            If the move did not request the report "swept" of all faces, or if the session was resumed.
        """
        cells = (
            {} if self.mesh is None else {name: self.mesh.cells[name] for name in FACES_OF if name in self.mesh.cells}
        )
        counts = {name: (len(rows), FACES_OF[name]) for name, rows in cells.items()}
        ends = np.cumsum([m * f for m, f in counts.values()], dtype=np.int64)
        if self.swept is None or not cells or ends[-1] != len(self.swept):
            raise InvalidInput(
                "the volumes that the cells' faces sweep are not known here",
                hint="move with report='swept' and without swept_faces, in the session that uploaded the mesh",
            )
        parts = np.split(self.swept, ends[:-1])
        return {name: part.reshape(shape) for (name, shape), part in zip(counts.items(), parts, strict=True)}

    def tangent(self, velocity: ArrayLike, *, timeout: float | None = None) -> NDArray[np.float64]:
        """J v at this trial, before or after its commit: see :meth:`.session.Session.tangent`.

        Raises
        ------
        SessionError
            If another trial has replaced it, or a later step is committed.
        """
        session = self._known_session()
        return session.tangent(velocity, session.state_of(self.step, self.iteration), timeout=timeout)

    def cotangent(self, weights: ArrayLike, *, timeout: float | None = None) -> NDArray[np.float64]:
        """Jᵀ w at this trial, before or after its commit: see :meth:`.session.Session.cotangent`.

        Raises
        ------
        SessionError
            As :meth:`tangent` does.
        """
        session = self._known_session()
        return session.cotangent(weights, session.state_of(self.step, self.iteration), timeout=timeout)

    def _known_session(self) -> Session:
        if self.session is None:
            raise InvalidInput("this answer does not know its session", hint="call session.tangent or .cotangent")
        return self.session

    def plot(self) -> Any:
        """Draw the moved mesh with its worst cells. See :func:`.display.draw`.

        Raises
        ------
        InvalidInput
            If the mesh is not known, or displacements count from the committed state.
        """
        mesh, title = self._known_mesh(), self.description()[1].partition(";")[0]
        worst = self.quality["corrected"]["worst"]
        return draw(mesh, mesh.points + self.displacement, f"step {self.step}, {title}", worst)

    def to_pyvista(self) -> Any:
        """Return a ``pyvista.UnstructuredGrid`` of the moved mesh, with the point array ``displacement`` (n, 3).

        Raises
        ------
        InvalidInput
            As :meth:`plot` does.
        ModuleNotFoundError
            Without PyVista.
        """
        mesh = self._known_mesh()
        grid = to_pyvista(mesh, mesh.points + self.displacement)
        grid.point_data["displacement"] = np.pad(self.displacement, ((0, 0), (0, 3 - mesh.dimension)))
        return grid

    def _known_mesh(self) -> Mesh:
        """Return the mesh, if its moved nodes are known."""
        if self.mesh is None or not self.is_total:
            raise InvalidInput(
                "a picture needs the mesh, and displacements since the reference mesh",
                hint="plot in the session that uploaded the mesh, and move with frame='reference'",
            )
        return self.mesh
