"""Runs in Kratos' Python, in the folder of one run: the coupled computation of ``coupling.json``.

Leaves ``history.npz``: times (k,) s, displacements (k, points, 2) m of the wall's nodes of ``nodes.json``, the fluid's
mesh (k, n, 2) m, coupling iterations (k,), and seconds of the mesh solver and of the whole of each step (k,). A line of
standard output each time step: ``step K of N``.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import KratosMultiphysics as KM
import numpy as np
from KratosMultiphysics.CoSimulationApplication.co_simulation_analysis import CoSimulationAnalysis

__all__ = ["Run"]

#: The mesh solver's part in a step.
_TIMED = ("InitializeSolutionStep", "SolveSolutionStep", "FinalizeSolutionStep")


class Run(CoSimulationAnalysis):
    """The coupled computation with a clock and a notebook."""

    def __init__(self, folder: Path) -> None:
        self._nodes = json.loads((folder / "nodes.json").read_text())
        self._seconds, self._calls = 0.0, 0
        self._notes: dict[str, list[Any]] = {
            name: [] for name in ("times", "displacements", "points", "iterations", "mesh_seconds", "seconds")
        }
        super().__init__(KM.Parameters((folder / "coupling.json").read_text()))

    def Initialize(self) -> None:
        """As CoSimulation, with a clock around the mesh solver's part in a step."""
        super().Initialize()
        solver = self._mesh_solver()
        for name in _TIMED:
            setattr(solver, name, self._timed(getattr(solver, name), counts=name == "SolveSolutionStep"))
        self._began = time.perf_counter()

    def Finalize(self) -> None:
        """Take the clock off: what holds itself would be freed after Kratos has shut down, and crash."""
        for name in _TIMED:
            delattr(self._mesh_solver(), name)
        super().Finalize()

    def OutputSolutionStep(self) -> None:
        """Write the step down."""
        super().OutputSolutionStep()
        now = time.perf_counter()
        wall = self._part("structure", "Structure")
        fluid = self._part("fluid", "FluidModelPart")
        points = KM.VariableUtils().GetCurrentPositionsVector(fluid.Nodes, 2)
        self._note("times", self.time)
        self._note(
            "displacements",
            [list(wall.GetNode(node).GetSolutionStepValue(KM.DISPLACEMENT))[:2] for node in self._nodes],
        )
        self._note("points", np.array(points).reshape(-1, 2))
        self._note("iterations", self._calls)
        self._note("mesh_seconds", self._seconds)
        self._note("seconds", now - self._began)
        self._seconds, self._calls = 0.0, 0
        done = len(self._notes["times"])
        sys.stdout.write(f"step {done} of {max(done, round(self.end_time / self.time * done))}\n")
        sys.stdout.flush()
        self._began = time.perf_counter()

    def save(self, path: Path) -> None:
        """Write the notebook."""
        arrays: dict[str, Any] = {name: np.array(values) for name, values in self._notes.items()}
        np.savez_compressed(path, **arrays)

    def _note(self, name: str, value: Any) -> None:
        self._notes[name].append(value)

    def _part(self, solver: str, name: str) -> Any:
        return self._GetSolver(solver).model[name]

    def _mesh_solver(self) -> Any:
        return self._GetSolver("fluid")._analysis_stage._GetSolver().GetMeshMotionSolver()

    def _timed(self, call: Callable[[], Any], *, counts: bool) -> Callable[[], Any]:
        def timed() -> Any:
            began = time.perf_counter()
            try:
                return call()
            finally:
                self._seconds += time.perf_counter() - began
                self._calls += counts

        return timed


def main() -> None:
    """Run in the present folder."""
    KM.Logger.GetDefaultOutput().SetSeverity(KM.Logger.Severity.WARNING)
    run = Run(Path.cwd())
    run.Run()
    run.save(Path("history.npz"))


if __name__ == "__main__":
    main()
