"""The component: surface coordinates in, coordinates of all nodes out, both derivatives matrix-free and exact."""

from __future__ import annotations

from typing import Any

import numpy as np
import openmdao.api as om
from mesh_motion_client import QualityRefused, Session

__all__ = ["MeshMotion"]


class MeshMotion(om.ExplicitComponent):
    """Moves the volume mesh of a session with its surface.

    Inputs and outputs are named by MPhys' conventions, here for the discipline ``aero``:

    ``x_aero`` : (k d,) array, mesh length unit
        Coordinates of the moving nodes, in the order of ``session.moving_nodes``, one node after the other.
    ``aero_vol_coords`` : (n d,) array, mesh length unit
        Coordinates of all nodes.

    Each evaluation is a trial of the session; nothing is committed. The mesh is a function of the surface, so an
    optimiser may come back to any design. A surface for which no acceptable mesh is found is an ``AnalysisError``: a
    line search then takes a shorter step.

    Options
    -------
    session : Session
        Open, with derivatives (``session.derivatives``); its settings decide how the mesh moves.
    discipline : str
        In the names of input and output.
    """

    def initialize(self) -> None:
        """Declare the options."""
        self.options.declare("session", types=Session, desc="open session of the mesh", recordable=False)
        self.options.declare("discipline", default="aero", types=str, desc="part of the names")

    def setup(self) -> None:
        """Declare surface and volume.

        Raises
        ------
        ValueError
            If the session's method has no derivatives.
        """
        session: Session = self.options["session"]
        if session.derivatives is False:
            raise ValueError("the session's method has no derivatives: see docs/derivatives.md for the keys")
        name = self.options["discipline"]
        self._surface, self._volume = f"x_{name}", f"{name}_vol_coords"
        self._rest = session.points("reference")
        self.add_input(self._surface, val=self._rest[session.moving_nodes].ravel())
        self.add_output(self._volume, val=self._rest.ravel())
        self._at: np.ndarray[Any, Any] | None = None

    def compute(self, inputs: Any, outputs: Any, *_: Any) -> None:
        """Move the mesh.

        Raises
        ------
        openmdao.api.AnalysisError
            If no acceptable mesh is found.
        """
        outputs[self._volume] = (self._rest + self._moved(inputs[self._surface]).displacement).ravel()

    def compute_jacvec_product(self, inputs: Any, d_inputs: Any, d_outputs: Any, mode: str, *_: Any) -> None:
        """J v in mode ``"fwd"``, Jᵀ w in mode ``"rev"``."""
        if self._surface not in d_inputs or self._volume not in d_outputs:
            return
        self._moved(inputs[self._surface])
        session, d = self.options["session"], self._rest.shape[1]
        if mode == "fwd":
            d_outputs[self._volume] += session.tangent(d_inputs[self._surface].reshape(-1, d)).ravel()
        else:
            d_inputs[self._surface] += session.cotangent(d_outputs[self._volume].reshape(-1, d)).ravel()

    def _moved(self, surface: np.ndarray[Any, Any]) -> Any:
        """The trial for the surface's coordinates; that of the last call, if they are the same."""
        if self._at is None or not np.array_equal(surface, self._at):
            session, self._at = self.options["session"], None
            rest = self._rest[session.moving_nodes]
            try:
                self._trial = session.move(surface.reshape(rest.shape) - rest)
            except QualityRefused as refused:
                raise om.AnalysisError(str(refused)) from refused
            self._at = surface.copy()
        return self._trial
