"""A participant of CoSimulation that only moves a mesh: ``"type": "mesh_motion_kratos.mesh_wrapper"``.

For fluids whose mesh Kratos does not move. Its project parameters are those of ``MeshMovingAnalysis``; as coupling
data, MESH_DISPLACEMENT of the interface goes in, and that of the whole model part comes out.
"""

from __future__ import annotations

from typing import Any

import KratosMultiphysics as KM
from KratosMultiphysics.CoSimulationApplication.solver_wrappers.kratos.kratos_base_wrapper import KratosBaseWrapper
from KratosMultiphysics.MeshMovingApplication.mesh_moving_analysis import MeshMovingAnalysis

from mesh_motion_kratos.names import register

__all__ = ["Create", "MeshMotionWrapper"]


def Create(settings: Any, model: Any, solver_name: str) -> MeshMotionWrapper:
    """The wrapper, as CoSimulation creates it."""
    return MeshMotionWrapper(settings, model, solver_name)


class MeshMotionWrapper(KratosBaseWrapper):
    """``MeshMovingAnalysis`` as a solver of CoSimulation."""

    def _CreateAnalysisStage(self) -> Any:
        register()
        return MeshMovingAnalysis(self.model, self.project_parameters)

    def _GetDataCommunicator(self) -> Any:
        return KM.ParallelEnvironment.GetDataCommunicator("Serial")
