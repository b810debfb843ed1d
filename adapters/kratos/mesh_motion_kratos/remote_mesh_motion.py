"""The mesh solver: ``"solver_type": "mesh_motion_kratos.remote_mesh_motion"``.

Kratos' ``MeshSolverBase`` with another strategy. Variables, degrees of freedom, buffer, coordinates, MESH_VELOCITY by
the time scheme that is set, and superimposed motions are Kratos' own; settings of Kratos' linear systems are allowed
and have no effect, so that a case changes from one mesh solver to the other by its ``solver_type``.
"""

from __future__ import annotations

from typing import Any

import KratosMultiphysics as KM
from KratosMultiphysics.MeshMovingApplication.mesh_solver_base import MeshSolverBase

from mesh_motion_kratos.errors import SettingsError
from mesh_motion_kratos.part import KratosPart
from mesh_motion_kratos.participant import Participant
from mesh_motion_kratos.settings import RemoteSettings

__all__ = ["CreateSolver", "RemoteMeshSolver", "RemoteStrategy"]

_NAME = "::[RemoteMeshSolver]::"


def CreateSolver(model: Any, settings: Any) -> RemoteMeshSolver:
    """The mesh solver, as Kratos' wrappers create it."""
    return RemoteMeshSolver(model, settings)


class RemoteStrategy:
    """The methods of a solution strategy that ``MeshSolverBase`` calls.

    The session begins with the first step, after the processes have fixed their nodes.
    """

    def __init__(self, model_part: Any, settings: RemoteSettings, echo_level: int) -> None:
        self._model_part, self._settings, self._echo_level = model_part, settings, echo_level
        self._participant: Participant | None = None

    @property
    def participant(self) -> Participant:
        """The part and its session; opens the session at the first call."""
        if self._participant is None:
            info = self._model_part.ProcessInfo
            self._participant = Participant(
                KratosPart(self._model_part, info[KM.DOMAIN_SIZE]),
                self._settings,
                restarted=bool(info[KM.IS_RESTARTED]),
                warn=_warn,
            )
            self._print(1, f"session {self._participant.session.credentials.session}")
        return self._participant

    def Initialize(self) -> None:
        """Do nothing yet: the fixed nodes are known when the first step begins."""

    def InitializeSolutionStep(self) -> None:
        """Begin the session, or check that the same nodes are fixed."""
        self.participant.check_roles()

    def Predict(self) -> None:
        """Do nothing: the last committed mesh is the prediction."""

    def Solve(self) -> bool:
        """Move the mesh from the last committed one, as often as the coupling calls this."""
        moved = self.participant.move()
        quality = moved.quality["corrected"]["metric"]["min"]
        self._print(1, f"iteration {moved.iteration}: {moved.quality['metric']} {quality:.3f} at the worst cell")
        return True

    def FinalizeSolutionStep(self) -> None:
        """Commit the step's last mesh."""
        committed = self.participant.commit()
        if committed is not None:
            self._print(1, f"step {committed.step} committed")

    def SetEchoLevel(self, level: int) -> None:
        """From 1 on every move prints its quality."""
        self._echo_level = level

    def GetEchoLevel(self) -> int:
        """The echo level in force."""
        return self._echo_level

    def Clear(self) -> None:
        """Do nothing: there are no data to clear."""

    def close(self) -> None:
        """End the session's use; idempotent."""
        if self._participant is not None:
            self._participant.close()

    def _print(self, level: int, text: str) -> None:
        if self._echo_level >= level:
            KM.Logger.PrintInfo(_NAME, text)


class RemoteMeshSolver(MeshSolverBase):
    """A mesh solver of Kratos that uses the mesh-motion server.

    Its settings are those of ``MeshSolverBase`` and a block ``"remote"``: :class:`~.settings.RemoteSettings`.
    """

    def __init__(self, model: Any, settings: Any) -> None:
        super().__init__(model, settings)
        self._remote_settings = RemoteSettings.from_json(self.settings["remote"].WriteJsonString())
        if KM.IsDistributedRun():
            raise SettingsError("the remote mesh solver runs without MPI only", 'set "parallel_type" to "OpenMP"')

    @classmethod
    def GetDefaultParameters(cls) -> Any:
        """The base class' defaults and an empty block ``"remote"``."""
        defaults = KM.Parameters('{"solver_type": "mesh_motion_kratos.remote_mesh_motion", "remote": {}}')
        defaults.AddMissingParameters(super().GetDefaultParameters())
        return defaults

    def Finalize(self) -> None:
        """End the session's use."""
        self._GetSolutionStrategy().close()
        super().Finalize()

    def _CreateSolutionStrategy(self) -> RemoteStrategy:
        return RemoteStrategy(self.mesh_model_part, self._remote_settings, self.echo_level)


def _warn(text: str) -> None:
    KM.Logger.PrintWarning(_NAME, text)
