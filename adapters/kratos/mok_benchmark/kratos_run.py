"""The coupled computation of ``coupling.json``; runs in Kratos' Python, in the folder of one run.

``watch.json``: ``nodes`` of the solid, ``forces``: parts of the fluid's boundary, ``meshes``: whether to keep them.
Leaves ``history.npz``: times (k,) s, displacements (k, nodes, 2) m, the flow's force (k, 2) N/m on the parts together,
the fluid's mesh (k, n, 2) m, coupling iterations (k,), and seconds of the mesh solver and of the whole of each step
(k,). Standard output has one line for each time step: ``step K of N``. Every ``EVERY`` steps it also writes
``state.npz``: a run that finds this file continues from its step.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import KratosMultiphysics as KM
import numpy as np
from KratosMultiphysics.CoSimulationApplication.co_simulation_analysis import CoSimulationAnalysis

__all__ = ["EVERY", "Run"]

#: Steps from one ``state.npz`` to the next.
EVERY = 25
#: Data of the next step in addition to coordinates: for each solver its model part and nodal variables.
_STATE = {
    "fluid": ("FluidModelPart", "MESH_DISPLACEMENT", "MESH_VELOCITY", "MESH_ACCELERATION", "VELOCITY", "ACCELERATION",
              "PRESSURE"),
    "structure": ("Structure", "DISPLACEMENT", "VELOCITY", "ACCELERATION"),
}  # fmt: skip

#: The mesh solver's part in a step.
_TIMED = ("InitializeSolutionStep", "SolveSolutionStep", "FinalizeSolutionStep")


class Run(CoSimulationAnalysis):
    """The coupled computation, with times measured and results recorded."""

    def __init__(self, folder: Path) -> None:
        self._watch = json.loads((folder / "watch.json").read_text())
        self._seconds, self._calls = 0.0, 0
        self._notes: dict[str, list[Any]] = {
            name: [] for name in ("times", "displacements", "forces", "points", "iterations", "mesh_seconds", "seconds")
        }
        settings = json.loads((folder / "coupling.json").read_text())
        self._state: dict[str, Any] = dict(np.load(folder / "state.npz")) if (folder / "state.npz").exists() else {}
        if self._state:
            with np.load(folder / "history.npz") as kept:
                self._notes = {name: list(kept[name][: int(self._state["steps"])]) for name in self._notes}
            solvers = settings["solver_settings"]["solvers"].values()
            for block in (settings, *(solver["solver_wrapper_settings"] for solver in solvers)):
                block["problem_data"]["start_time"] = self._notes["times"][-1]
        super().__init__(KM.Parameters(json.dumps(settings)))

    def Initialize(self) -> None:
        """Initialize as CoSimulation does, and measure the time of the mesh solver in each step."""
        super().Initialize()
        solver = self._mesh_solver()
        for name in _TIMED:
            setattr(solver, name, self._timed(getattr(solver, name), counts=name == "SolveSolutionStep"))
        fluid = self._model_part("fluid")
        wetted = {node.Id: node for name in self._watch["forces"] for node in fluid.GetSubModelPart(name).Nodes}
        self._wetted = list(wetted.values())
        if self._state:
            self._go_on()
        self._began = time.perf_counter()

    def Finalize(self) -> None:
        """Remove the clock: a reference cycle would be freed after Kratos has shut down, and crash."""
        self._wetted.clear()
        for name in _TIMED:
            delattr(self._mesh_solver(), name)
        super().Finalize()

    def OutputSolutionStep(self) -> None:
        """Write the step down."""
        super().OutputSolutionStep()
        now = time.perf_counter()
        wall = self._model_part("structure")
        self._note("times", self.time)
        self._note(
            "displacements",
            [list(wall.GetNode(node).GetSolutionStepValue(KM.DISPLACEMENT))[:2] for node in self._watch["nodes"]],
        )
        reactions = [list(node.GetSolutionStepValue(KM.REACTION))[:2] for node in self._wetted]
        self._note("forces", -np.sum(reactions, axis=0))
        if self._watch["meshes"]:
            points = KM.VariableUtils().GetCurrentPositionsVector(self._model_part("fluid").Nodes, 2)
            self._note("points", np.array(points).reshape(-1, 2))
        self._note("iterations", self._calls)
        self._note("mesh_seconds", self._seconds)
        self._note("seconds", now - self._began)
        self._seconds, self._calls = 0.0, 0
        done = len(self._notes["times"])
        if done % EVERY == 0:
            self.save(Path("history.npz"))
            self._save_state(Path("state.npz"))
        sys.stdout.write(f"step {done} of {max(done, round(self.end_time / self.time * done))}\n")
        sys.stdout.flush()
        self._began = time.perf_counter()

    def save(self, path: Path) -> None:
        """Write the notebook."""
        _save(path, {name: np.array(values) for name, values in self._notes.items()})

    def _save_state(self, path: Path) -> None:
        """Write the data that the next step needs."""
        arrays: dict[str, Any] = {
            f"{solver}.places": KM.VariableUtils().GetCurrentPositionsVector(self._model_part(solver).Nodes, 3)
            for solver in _STATE
        }
        arrays |= {
            name: np.array(KM.VariableUtils().GetSolutionStepValuesVector(nodes, variable, back, *size))
            for name, nodes, variable, back, size in self._variables()
        }
        _save(path, {"steps": np.array(len(self._notes["times"])), **arrays})

    def _go_on(self) -> None:
        """Load the state of an earlier run."""
        for name, nodes, variable, back, _ in self._variables():
            KM.VariableUtils().SetSolutionStepValuesVector(nodes, variable, KM.Vector(self._state[name]), back)
        for solver in _STATE:
            model_part = self._model_part(solver)
            # not from the displacement: at the interface the displacement is already the solid's answer to the last
            # mesh
            places = KM.Vector(self._state[f"{solver}.places"])
            KM.VariableUtils().SetCurrentPositionsVector(model_part.Nodes, places)
            model_part.ProcessInfo[KM.STEP] = int(self._state["steps"])
            model_part.ProcessInfo[KM.IS_RESTARTED] = True  # the mesh's session is taken up again

    def _variables(self) -> Iterator[tuple[str, Any, Any, int, list[int]]]:
        """The entries of the state: key, nodes, variable, steps back, and the components of a vector."""
        for solver, (_, *names) in _STATE.items():
            model_part = self._model_part(solver)
            for name in names:
                for back in range(model_part.GetBufferSize()):
                    variable = KM.KratosGlobals.GetVariable(name)
                    yield f"{solver}.{name}.{back}", model_part.Nodes, variable, back, [] if name == "PRESSURE" else [3]

    def _note(self, name: str, value: Any) -> None:
        self._notes[name].append(value)

    def _model_part(self, solver: str) -> Any:
        return self._GetSolver(solver).model[_STATE[solver][0]]

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


def _save(path: Path, arrays: dict[str, Any]) -> None:
    """Write an npz file, complete or not at all."""
    with path.with_suffix(".new").open("wb") as file:
        np.savez_compressed(file, **arrays)
    path.with_suffix(".new").rename(path)


def main() -> None:
    """Run in the present folder."""
    KM.Logger.GetDefaultOutput().SetSeverity(KM.Logger.Severity.WARNING)
    run = Run(Path.cwd())
    run.Run()
    run.save(Path("history.npz"))


if __name__ == "__main__":
    main()
