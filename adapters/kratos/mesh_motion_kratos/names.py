"""Adds modules' names to ``python_solvers_wrapper_mesh_motion``, the list by which Kratos finds its mesh solvers.

Every user of that list (MeshMovingAnalysis, the ALE fluid solver, the FSI solvers) then takes as ``solver_type`` also
the full name of a module with a function ``CreateSolver(model, settings)``.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

__all__ = ["register"]


def register() -> None:
    """Make Kratos accept a module's full name (one with a dot) as the ``solver_type`` of a mesh solver; idempotent."""
    wrapper: Any = import_module("KratosMultiphysics.MeshMovingApplication.python_solvers_wrapper_mesh_motion")
    known = wrapper.CreateSolverByParameters
    if getattr(known, "takes_modules", False):
        return

    def create(model: Any, settings: Any, parallelism: str) -> Any:
        name = settings["solver_type"].GetString()
        if "." not in name:
            return known(model, settings, parallelism)
        return import_module(name).CreateSolver(model, settings)

    create.takes_modules = True  # type: ignore[attr-defined]
    wrapper.CreateSolverByParameters = create
