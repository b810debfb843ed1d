"""Runs in Kratos' Python: plays the jobs of folders with a mesh solver and writes each result into its folder.

``job.json`` has the solver's settings and the steps, each a list of iterations: displacements by sub model part.
``mesh.npz`` has points, cells (``cells_triangle`` …) and the nodes of each part (``part_wall`` …), numbered from 0.
"""

import json
import sys
from pathlib import Path

import KratosMultiphysics as KM
import mesh_motion_kratos
import numpy as np
from KratosMultiphysics.MeshMovingApplication.python_solvers_wrapper_mesh_motion import CreateSolver
from KratosMultiphysics.restart_utility import RestartUtility

ELEMENTS = {
    "line": "Element2D2N",
    "triangle": "Element2D3N",
    "quad": "Element2D4N",
    "tetra": "Element3D4N",
    "pyramid": "Element3D5N",
    "wedge": "Element3D6N",
    "hexahedron": "Element3D8N",
}
COMPONENTS = (KM.MESH_DISPLACEMENT_X, KM.MESH_DISPLACEMENT_Y, KM.MESH_DISPLACEMENT_Z)


class Player:
    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.job = json.loads((folder / "job.json").read_text())
        self.mesh = dict(np.load(folder / "mesh.npz"))
        self.dimension = self.mesh["points"].shape[1]
        self.model = KM.Model()
        self.part = self.model.CreateModelPart("mesh")
        self.solver = CreateSolver(self.model, KM.Parameters(json.dumps(self.settings())))
        self.solver.AddVariables()
        if not self.job.get("load"):
            self.fill()
        self.solver.ImportModelPart()
        self.solver.PrepareModelPart()
        self.solver.AddDofs()
        self.solver.Initialize()
        self.time = self.part.ProcessInfo[KM.TIME]

    def settings(self):
        source = {"input_type": "use_input_model_part"}
        if self.job.get("load"):
            source = {"input_type": "rest", **self.restart_files(), "restart_load_file_label": self.job["load"]}
        solver = {
            "model_part_name": "mesh",
            "domain_size": self.dimension,
            "echo_level": 0,
            "buffer_size": 3,
            "time_stepping": {"time_step": self.job.get("dt", 0.5)},
            "mesh_velocity_calculation": {"time_scheme": "bdf2"},
            "model_import_settings": source,
        } | self.job["solver"]
        problem = {"echo_level": 0, "parallel_type": "OpenMP", "start_time": 0.0, "end_time": 1.0}
        return {"problem_data": problem, "solver_settings": solver}

    def restart_files(self):
        return {"input_filename": "mesh", "input_output_path": str(self.folder / "restart")}

    def fill(self) -> None:
        """Numbers with gaps and out of order, as in real meshes."""
        numbers = self.numbers = self.mesh.get("numbers", 1 + np.arange(len(self.mesh["points"]))).tolist()
        for number, x in zip(numbers, self.mesh["points"].tolist(), strict=True):
            self.part.CreateNewNode(number, *x, *[0.0] * (3 - self.dimension))
        properties = self.part.CreateNewProperties(0)
        element = 100
        for kind, name in ELEMENTS.items():
            for cell in self.mesh.get(f"cells_{kind}", np.empty((0, 1), int)).tolist():
                element += 1
                self.part.CreateNewElement(name, element, [numbers[node] for node in cell], properties)
        for key, nodes in self.mesh.items():
            if key.startswith("part_"):
                inner = self.part.CreateSubModelPart(key.removeprefix("part_"))
                inner.AddNodes([numbers[node] for node in nodes.tolist()])

    def prescribe(self, name: str, values) -> None:
        for node, value in zip(self.part.GetSubModelPart(name).Nodes, np.array(values).tolist(), strict=True):
            for component, x in zip(COMPONENTS, value, strict=False):
                node.SetSolutionStepValue(component, 0, x)

    def fix(self) -> None:
        for name, axes in self.job["fix"].items():
            for node in self.part.GetSubModelPart(name).Nodes:
                for axis in axes:
                    node.Fix(COMPONENTS[axis])

    def release(self, names) -> None:
        for name in names:
            for node in self.part.GetSubModelPart(name).Nodes:
                for component in COMPONENTS:
                    node.Free(component)

    def play(self):
        iterations, velocities, points = [], [], []
        for number, step in enumerate(self.job["steps"]):
            self.time = self.solver.AdvanceInTime(self.time)
            self.fix()
            self.release(self.job.get("release", {}).get(str(number), []))
            self.solver.Predict()
            self.solver.InitializeSolutionStep()
            for iteration in step:
                for name, values in iteration.items():
                    self.prescribe(name, values)
                self.solver.SolveSolutionStep()
                iterations.append(self.rows(KM.MESH_DISPLACEMENT))
            self.solver.FinalizeSolutionStep()
            velocities.append(self.rows(KM.MESH_VELOCITY))
            current = KM.VariableUtils().GetCurrentPositionsVector(self.part.Nodes, self.dimension)
            points.append(np.array(current).reshape(-1, self.dimension))
            if number in self.job.get("save", []):
                RestartUtility(self.part, KM.Parameters(json.dumps(self.restart_files()))).SaveRestart()
        if self.job.get("finalize", True):
            self.solver.Finalize()
        np.savez(self.folder / "result.npz", iterations=iterations, velocities=velocities, points=points)

    def rows(self, variable):
        vector = KM.VariableUtils().GetSolutionStepValuesVector(self.part.Nodes, variable, 0, self.dimension)
        return np.array(vector).reshape(-1, self.dimension)


def ending(folder: Path) -> str:
    try:
        Player(folder).play()
    except Exception as error:
        return f"{type(error).__name__}: {error}".replace("\n", " ")
    return ""


if __name__ == "__main__":
    mesh_motion_kratos.register()
    mesh_motion_kratos.register()  # the second call has no effect
    for name in sys.argv[1:]:
        sys.stdout.write(f"\nended: {ending(Path(name))}\n")
