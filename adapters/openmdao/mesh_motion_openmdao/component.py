"""The component: surface coordinates in, coordinates of all nodes out, both derivatives matrix-free and exact."""

from __future__ import annotations

from typing import Any

import numpy as np
import openmdao.api as om
from mesh_motion_client import InvalidInput, QualityRefused, Session
from mesh_motion_client.motion_function import MotionFunction

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
        The part of the input's and output's names that names the discipline.
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
        try:
            self._motion = MotionFunction(session)
        except InvalidInput as error:
            raise ValueError(str(error)) from error
        name = self.options["discipline"]
        self._surface, self._volume = f"x_{name}", f"{name}_vol_coords"
        self._rest = session.points("reference")
        self.add_input(self._surface, val=self._rest[session.moving_nodes].ravel())
        self.add_output(self._volume, val=self._rest.ravel())

    def compute(self, inputs: Any, outputs: Any, *_: Any) -> None:
        """Move the mesh.

        Raises
        ------
        openmdao.api.AnalysisError
            If no acceptable mesh is found.
        """
        try:
            moved = self._motion.value(self._displacement(inputs))
        except QualityRefused as refused:
            raise om.AnalysisError(str(refused)) from refused
        outputs[self._volume] = (self._rest + moved).ravel()

    def compute_jacvec_product(self, inputs: Any, d_inputs: Any, d_outputs: Any, mode: str, *_: Any) -> None:
        """J v in mode ``"fwd"``, Jᵀ w in mode ``"rev"``."""
        if self._surface not in d_inputs or self._volume not in d_outputs:
            return
        at, d = self._displacement(inputs), self._rest.shape[1]
        if mode == "fwd":
            d_outputs[self._volume] += self._motion.tangent(at, d_inputs[self._surface].reshape(-1, d)).ravel()
        else:
            d_inputs[self._surface] += self._motion.cotangent(at, d_outputs[self._volume].reshape(-1, d)).ravel()

    def _displacement(self, inputs: Any) -> np.ndarray[Any, Any]:
        """(k, d) coordinates of the moving nodes."""
        rest = self._rest[self.options["session"].moving_nodes]
        return np.asarray(inputs[self._surface].reshape(rest.shape) - rest)
