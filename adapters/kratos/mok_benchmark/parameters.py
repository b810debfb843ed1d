"""Kratos' project parameters of the benchmark; the runs differ in the fluid's ``mesh_motion_solver_settings`` only."""

from __future__ import annotations

from typing import Any

from mok_benchmark.benchmark import (
    END_TIME,
    PEAK_VELOCITY,
    POISSON,
    RAMP_TIME,
    SOLID_DENSITY,
    TIME_STEP,
    YOUNG,
)

__all__ = ["MESH_SOLVERS", "coupling", "materials"]

Block = dict[str, Any]

#: The settings that are swapped; the endpoint is put in when the server runs.
MESH_SOLVERS: dict[str, Block] = {
    "structural similarity": {"solver_type": "structural_similarity"},
    "mesh-motion server": {
        "solver_type": "mesh_motion_kratos.remote_mesh_motion",
        "remote": {"endpoint": "$MESH_MOTION_ENDPOINT"},
    },
}


def materials() -> Block:
    """The wall's material: linear elastic, plane stress, thickness 1."""
    variables = {"DENSITY": SOLID_DENSITY, "YOUNG_MODULUS": YOUNG, "POISSON_RATIO": POISSON, "THICKNESS": 1.0}
    law = {"constitutive_law": {"name": "LinearElasticPlaneStress2DLaw"}, "Variables": variables, "Tables": {}}
    return {"properties": [{"model_part_name": "Structure.Parts_Structure", "properties_id": 1, "Material": law}]}


def coupling(mesh_solver: Block, end_time: float = END_TIME) -> Block:
    """CoSimulation's parameters: implicit coupling, quasi-Newton on the interface's displacement."""
    interface = {"solver": "fluid", "data_name": "disp"}
    transfer = {"data_transfer_operator": "mapper"}
    solver = {
        "type": "coupled_solvers.gauss_seidel_strong",
        "echo_level": 0,
        "num_coupling_iterations": 20,
        "convergence_accelerators": [{"type": "mvqn", **interface}],
        "convergence_criteria": [
            {"type": "relative_norm_previous_residual", "abs_tolerance": 1e-7, "rel_tolerance": 1e-5, **interface}
        ],
        "data_transfer_operators": {
            "mapper": {"type": "kratos_mapping", "mapper_settings": {"mapper_type": "nearest_neighbor"}}
        },
        "coupling_sequence": [
            {"name": "fluid", "input_data_list": [], "output_data_list": []},
            {
                "name": "structure",
                "input_data_list": [
                    {
                        "data": "load", "from_solver": "fluid", "from_solver_data": "load", **transfer,
                        "data_transfer_operator_options": ["swap_sign", "use_transpose"],
                    }
                ],
                "output_data_list": [{"data": "disp", "to_solver": "fluid", "to_solver_data": "disp", **transfer}],
            },
        ],
        "solvers": {
            "fluid": {
                "type": "mesh_motion_kratos.fluid_wrapper",
                "solver_wrapper_settings": _fluid(mesh_solver, end_time),
                "data": _data("FluidModelPart.interface", "MESH_DISPLACEMENT", "REACTION"),
            },
            "structure": {
                "type": "solver_wrappers.kratos.structural_mechanics_wrapper",
                "solver_wrapper_settings": _structure(end_time),
                "data": _data("Structure.interface", "DISPLACEMENT", "POINT_LOAD"),
            },
        },
    }  # fmt: skip
    return {"problem_data": _problem("mok", end_time), "solver_settings": solver}


def _problem(name: str, end_time: float) -> Block:
    return {
        "problem_name": name, "parallel_type": "OpenMP", "echo_level": 0, "start_time": 0.0, "end_time": end_time
    }  # fmt: skip


def _data(part: str, displacement: str, load: str) -> Block:
    return {
        "disp": {"model_part_name": part, "dimension": 2, "variable_name": displacement},
        "load": {"model_part_name": part, "dimension": 2, "variable_name": load},
    }


def _fluid(mesh_solver: Block, end_time: float) -> Block:
    boundary = ["inlet", "outlet", "top", "bottom", "interface"]
    fluid = {
        "solver_type": "Monolithic",
        "domain_size": 2,
        "model_part_name": "FluidModelPart",
        "model_import_settings": {"input_type": "mdpa", "input_filename": "fluid"},
        "echo_level": 0,
        "compute_reactions": True,
        "formulation": {"element_type": "vms", "use_orthogonal_subscales": False, "dynamic_tau": 1.0},
        "maximum_iterations": 10,
        **{f"{kind}_{of}_tolerance": 1e-6 for kind in ("relative", "absolute") for of in ("velocity", "pressure")},
        "volume_model_part_name": "Parts_Fluid",
        "skin_parts": boundary,
        "no_skin_parts": [],
        "linear_solver_settings": {"solver_type": "LinearSolversApplication.sparse_lu"},
        "time_stepping": {"automatic_time_step": False, "time_step": TIME_STEP},
    }
    rising = f"2*{PEAK_VELOCITY}*(1-cos(pi*t/{RAMP_TIME}))*y*(1-y)"
    conditions = [
        _inlet(rising, [0.0, RAMP_TIME]),
        _inlet(f"4*{PEAK_VELOCITY}*y*(1-y)", [RAMP_TIME, "End"]),
        _process("apply_outlet_process", "outlet", fluid=True, variable_name="PRESSURE", constrained=True, value=0.0,
                 hydrostatic_outlet=False, h_top=0.0),
        _process("apply_noslip_process", "bottom", fluid=True),
        _process("apply_noslip_process", "interface", fluid=True),
        _process("apply_slip_process", "top", fluid=True),
    ]  # fmt: skip
    held = [
        _process("fix_vector_variable_process", part, variable_name="MESH_DISPLACEMENT", constrained=[True] * 3)
        for part in boundary
    ]
    return {
        "problem_data": _problem("fluid", end_time),
        "solver_settings": {
            "solver_type": "ale_fluid",
            "ale_boundary_parts": ["interface"],
            "mesh_motion_solver_settings": mesh_solver,
            "fluid_solver_settings": fluid,
        },
        "processes": {"boundary_conditions_process_list": conditions, "ale_boundary_conditions": held},
        "output_processes": {},
    }


def _inlet(velocity: str, interval: list[float | str]) -> Block:
    return _process(
        "assign_vector_by_direction_process", "inlet", variable_name="VELOCITY", modulus=velocity, constrained=True,
        direction="automatic_inwards_normal", interval=interval,
    )  # fmt: skip


def _process(module: str, part: str, *, fluid: bool = False, **settings: Any) -> Block:
    """One process on a part of the fluid's boundary; ``fluid``: one of the FluidDynamicsApplication."""
    application = "KratosMultiphysics.FluidDynamicsApplication" if fluid else "KratosMultiphysics"
    parameters = {"model_part_name": f"FluidModelPart.{part}", **settings}
    return {"python_module": module, "kratos_module": application, "Parameters": parameters}


def _structure(end_time: float) -> Block:
    solver = {
        "solver_type": "dynamic",
        "echo_level": 0,
        "analysis_type": "non_linear",
        "time_integration_method": "implicit",
        "scheme_type": "newmark",
        "model_part_name": "Structure",
        "domain_size": 2,
        "model_import_settings": {"input_type": "mdpa", "input_filename": "wall"},
        "material_import_settings": {"materials_filename": "materials.json"},
        "time_stepping": {"time_step": TIME_STEP},
        "line_search": False,
        "convergence_criterion": "residual_criterion",
        **{f"{of}_{kind}_tolerance": 1e-6 for kind in ("relative", "absolute") for of in ("displacement", "residual")},
        "max_iteration": 25,
        "linear_solver_settings": {"solver_type": "LinearSolversApplication.sparse_lu"},
        "rotation_dofs": False,
    }
    clamp = {
        "python_module": "assign_vector_variable_process",
        "kratos_module": "KratosMultiphysics",
        "Parameters": {
            "model_part_name": "Structure.bottom", "variable_name": "DISPLACEMENT", "constrained": [True] * 3,
            "value": [0.0] * 3, "interval": [0.0, "End"],
        },
    }  # fmt: skip
    return {
        "problem_data": _problem("wall", end_time),
        "solver_settings": solver,
        "processes": {"constraints_process_list": [clamp]},
        "output_processes": {},
    }
