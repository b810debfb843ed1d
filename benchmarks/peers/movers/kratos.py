"""Kratos' MeshMovingApplication, built in memory; runs in the Python of an environment that has Kratos.

Elements, solvers and linear-solver settings are the application's defaults (AMG-preconditioned GMRES to 1e-7); only the
mesh velocity is not computed.
"""

from __future__ import annotations

import KratosMultiphysics as KM  # type: ignore[import-not-found, unused-ignore]
import numpy as np
from KratosMultiphysics.MeshMovingApplication.python_solvers_wrapper_mesh_motion import (  # type: ignore[import-not-found, unused-ignore]
    CreateSolver,
)
from numpy.typing import NDArray

from benchmarks.peers.task import Task

__all__ = ["KratosMover"]

_ELEMENTS = {"triangle": "2D3N", "quad": "2D4N", "tetra": "3D4N", "hexahedron": "3D8N"}


class KratosMover:
    """One of Kratos' mesh-motion solvers.

    Parameters
    ----------
    solver : {"laplacian", "structural_similarity"}
    """

    def __init__(self, task: Task, *, solver: str = "laplacian") -> None:
        KM.Logger.GetDefaultOutput().SetSeverity(KM.Logger.Severity.WARNING)
        self.task = task
        dimension = task.points.shape[1]
        self.axes = [KM.MESH_DISPLACEMENT_X, KM.MESH_DISPLACEMENT_Y, KM.MESH_DISPLACEMENT_Z][:dimension]
        self.model = KM.Model()
        self.part = self.model.CreateModelPart("mesh")
        settings = KM.Parameters(
            '{"problem_data": {"echo_level": 0, "parallel_type": "OpenMP", "start_time": 0.0, "end_time": 1.0},'
            f'"solver_settings": {{"solver_type": "{solver}", "model_part_name": "mesh", "domain_size": {dimension},'
            '"echo_level": 0, "buffer_size": 2, "calculate_mesh_velocity": false, "time_stepping": {"time_step": 1.0},'
            '"model_import_settings": {"input_type": "use_input_model_part"}}}'
        )
        self.solver = CreateSolver(self.model, settings)
        self.solver.AddVariables()
        self._fill()
        self.solver.ImportModelPart()
        self.solver.PrepareModelPart()
        self.solver.AddDofs()
        self._fix()
        self.solver.Initialize()
        self.time = 0.0

    def move(self, step: int) -> NDArray[np.float64]:
        """Positions after a step."""
        self.time = self.solver.AdvanceInTime(self.time)
        displacements = self.task.displacements[step]
        for node, displacement in zip(self.task.moving.tolist(), displacements.tolist(), strict=True):
            kratos_node = self.part.Nodes[node + 1]
            for axis, value in zip(self.axes, displacement, strict=True):
                kratos_node.SetSolutionStepValue(axis, 0, value)
        self.solver.InitializeSolutionStep()
        self.solver.Predict()
        self.solver.SolveSolutionStep()
        self.solver.FinalizeSolutionStep()
        flat = KM.VariableUtils().GetCurrentPositionsVector(self.part.Nodes, len(self.axes))
        return np.array(flat).reshape(-1, len(self.axes))

    def _fill(self) -> None:
        """Nodes and elements; Kratos numbers from 1."""
        dimension = len(self.axes)
        for number, x in enumerate(self.task.points.tolist(), start=1):
            self.part.CreateNewNode(number, *x, *[0.0] * (3 - dimension))
        properties = self.part.CreateNewProperties(0)
        number = 0
        for name, nodes in self.task.cells.items():
            for cell in (nodes + 1).tolist():
                number += 1
                self.part.CreateNewElement(f"Element{_ELEMENTS[name]}", number, cell, properties)

    def _fix(self) -> None:
        """All components of all boundary nodes are prescribed."""
        for node in np.concatenate([self.task.moving, self.task.fixed]).tolist():
            for axis in self.axes:
                self.part.Nodes[node + 1].Fix(axis)
