"""A participant of CoSimulation that only moves a mesh: ``"type": "mesh_motion_kratos.mesh_wrapper"``.

This wrapper is for fluids whose mesh Kratos does not move. Its project parameters are those of ``MeshMovingAnalysis``.
Coupling data: MESH_DISPLACEMENT of the interface is the input, MESH_DISPLACEMENT of the whole model part the output.
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
