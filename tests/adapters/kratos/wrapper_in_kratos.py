"""Runs in Kratos' Python: a plate as a participant of CoSimulation that only moves a mesh, two steps of two iterations.

Takes the folder with ``plate.mdpa`` and ``turns.npz``; ``result.npz`` gets all displacements after each step.
"""

import json
import sys
from pathlib import Path

import KratosMultiphysics as KM
import numpy as np
from KratosMultiphysics.CoSimulationApplication.factories.solver_wrapper_factory import CreateSolverWrapper


def parameters(endpoint: str):
    held = {
        "python_module": "fix_vector_variable_process",
        "kratos_module": "KratosMultiphysics",
        "Parameters": {
            "model_part_name": "plate.wall", "variable_name": "MESH_DISPLACEMENT", "constrained": [True] * 3
        },
    }  # fmt: skip
    solver = {
        "solver_type": "mesh_motion_kratos.remote_mesh_motion",
        "model_part_name": "plate",
        "domain_size": 2,
        "echo_level": 1,
        "time_stepping": {"time_step": 0.1},
        "model_import_settings": {"input_type": "mdpa", "input_filename": "plate"},
        "remote": {"endpoint": endpoint, "method": {"basis": "tps"}},
    }
    analysis = {
        "problem_data": {"echo_level": 0, "parallel_type": "OpenMP", "start_time": 0.0, "end_time": 1.0},
        "solver_settings": solver,
        "processes": {"held": [held]},
        "output_processes": {},
    }
    data = {
        name: {"model_part_name": part, "dimension": 2, "variable_name": "MESH_DISPLACEMENT"}
        for name, part in {"boundary": "plate.wall", "mesh": "plate"}.items()
    }
    return {"type": "mesh_motion_kratos.mesh_wrapper", "solver_wrapper_settings": analysis, "data": data}


def main(folder: Path, endpoint: str) -> None:
    wrapper = CreateSolverWrapper(KM.Parameters(json.dumps(parameters(endpoint))), None, "mesh")
    wrapper.Initialize()
    time, answers = 0.0, []
    for turn in np.load(folder / "turns.npz")["turns"]:
        time = wrapper.AdvanceInTime(time)
        wrapper.Predict()
        wrapper.InitializeSolutionStep()
        for factor in (0.3, 1.0):
            wrapper.GetInterfaceData("boundary").SetData(factor * turn.ravel())
            wrapper.SolveSolutionStep()
        answers.append(np.array(wrapper.GetInterfaceData("mesh").GetData()).reshape(-1, 2))
        wrapper.FinalizeSolutionStep()
    wrapper.Finalize()
    np.savez(folder / "result.npz", answers=answers)


if __name__ == "__main__":
    main(Path.cwd(), sys.argv[1])
