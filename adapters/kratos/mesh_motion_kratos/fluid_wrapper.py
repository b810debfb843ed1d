"""CoSimulation's fluid, with any module as its mesh solver: ``"type": "mesh_motion_kratos.fluid_wrapper"``."""

from __future__ import annotations

from typing import Any

from KratosMultiphysics.CoSimulationApplication.solver_wrappers.kratos.fluid_dynamics_wrapper import (
    FluidDynamicsWrapper,
)

from mesh_motion_kratos.names import register

__all__ = ["Create"]


def Create(settings: Any, model: Any, solver_name: str) -> Any:
    """CoSimulation's own wrapper, which also accepts our mesh solver by its name."""
    register()
    return FluidDynamicsWrapper(settings, model, solver_name)
