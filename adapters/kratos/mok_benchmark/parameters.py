"""Kratos' project parameters of a case; the runs differ in the fluid's ``mesh_motion_solver_settings`` only."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

__all__ = ["MESH_SOLVERS", "Case", "coupling", "materials"]

Block = dict[str, Any]

#: The fluid's: on 6 000 nodes three times as fast as a direct one, and more on finer meshes.
_LINEAR_SOLVER: Block = {
    "solver_type": "amgcl",
    "smoother_type": "ilu0",
    "krylov_type": "gmres",
    "gmres_krylov_space_dimension": 100,
    "max_iteration": 200,
    "tolerance": 1e-6,
    "scaling": False,
}


@dataclass(frozen=True)
class Case:
    """A channel with an elastic solid in it: the values that differ between the benchmarks.

    Attributes
    ----------
    no_slip, slip : tuple of str
        Parts of the fluid's boundary, other than ``inlet``, ``outlet`` and the solid's ``interface``.
    inflow : tuple of pairs
        Velocity at the inlet in Kratos' words, and from when to when it holds.
    time_step : float
        s.
    tolerance : float
        Of the coupling: residual relative to the displacements.
    scheme : str
        Of the solid in time: newmark, or bossak, which damps what alternates from step to step.
    method : dict
        Settings of the server, where it moves the mesh.
    """

    no_slip: tuple[str, ...]
    slip: tuple[str, ...]
    inflow: tuple[tuple[str, tuple[float | str, float | str]], ...]
    time_step: float
    tolerance: float = 1e-5
    scheme: str = "newmark"
    method: Block = field(default_factory=dict)


#: The settings that are swapped; the endpoint is put in when the server runs.
MESH_SOLVERS: dict[str, Block] = {
    "structural similarity": {"solver_type": "structural_similarity"},
    "mesh-motion server": {
        "solver_type": "mesh_motion_kratos.remote_mesh_motion",
        "remote": {"endpoint": "$MESH_MOTION_ENDPOINT", "session_file": "session.json"},
    },
}


def materials(plane: str, density: float, young: float, poisson: float) -> Block:
    """The solid's material, linear between Green's strain and its stress; ``plane``: Stress or Strain, thickness 1."""
    variables = {"DENSITY": density, "YOUNG_MODULUS": young, "POISSON_RATIO": poisson, "THICKNESS": 1.0}
    law = {"constitutive_law": {"name": f"LinearElasticPlane{plane}2DLaw"}, "Variables": variables, "Tables": {}}
    return {"properties": [{"model_part_name": "Structure.Parts_Structure", "properties_id": 1, "Material": law}]}


def coupling(case: Case, mesh_solver: Block, end_time: float) -> Block:
    """CoSimulation's parameters: implicit coupling, quasi-Newton on the interface's displacement."""
    interface = {"solver": "fluid", "data_name": "disp"}
    transfer = {"data_transfer_operator": "mapper"}
    solver = {
        "type": "coupled_solvers.gauss_seidel_strong",
        "echo_level": 0,
        "num_coupling_iterations": 20,
        "predictors": [{"type": "linear_derivative_based", "derivative_data_name": "velocity", **interface}],
        "convergence_accelerators": [{"type": "iqnils", "timestep_horizon": 8, "alpha": 0.2, **interface}],
        "convergence_criteria": [
            {
                "type": "relative_norm_previous_residual", "abs_tolerance": 1e-7, "rel_tolerance": case.tolerance,
                **interface,
            }
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
                "solver_wrapper_settings": _fluid(case, mesh_solver, end_time),
                "data": _data(
                    "FluidModelPart.interface", disp="MESH_DISPLACEMENT", velocity="MESH_VELOCITY", load="REACTION"
                ),
            },
            "structure": {
                "type": "solver_wrappers.kratos.structural_mechanics_wrapper",
                "solver_wrapper_settings": _structure(case, end_time),
                "data": _data("Structure.interface", disp="DISPLACEMENT", load="POINT_LOAD"),
            },
        },
    }  # fmt: skip
    return {"problem_data": _problem("coupled", end_time), "solver_settings": solver}


def _problem(name: str, end_time: float) -> Block:
    return {
        "problem_name": name, "parallel_type": "OpenMP", "echo_level": 0, "start_time": 0.0, "end_time": end_time
    }  # fmt: skip


def _data(part: str, **variables: str) -> Block:
    return {
        name: {"model_part_name": part, "dimension": 2, "variable_name": variable}
        for name, variable in variables.items()
    }


def _fluid(case: Case, mesh_solver: Block, end_time: float) -> Block:
    boundary = ["inlet", "outlet", *case.slip, *case.no_slip, "interface"]
    fluid = {
        "solver_type": "Monolithic",
        "domain_size": 2,
        "model_part_name": "FluidModelPart",
        "model_import_settings": {"input_type": "mdpa", "input_filename": "fluid"},
        "echo_level": 0,
        "compute_reactions": True,
        "formulation": {"element_type": "vms", "use_orthogonal_subscales": False, "dynamic_tau": 1.0},
        "maximum_iterations": 10,
        **{f"{kind}_{of}_tolerance": 1e-5 for kind in ("relative", "absolute") for of in ("velocity", "pressure")},
        "volume_model_part_name": "Parts_Fluid",
        "skin_parts": boundary,
        "no_skin_parts": [],
        "linear_solver_settings": _LINEAR_SOLVER,
        "time_stepping": {"automatic_time_step": False, "time_step": case.time_step},
    }
    conditions = [
        *(_inlet(velocity, list(interval)) for velocity, interval in case.inflow),
        _process("apply_outlet_process", "outlet", fluid=True, variable_name="PRESSURE", constrained=True, value=0.0,
                 hydrostatic_outlet=False, h_top=0.0),
        *(_process("apply_noslip_process", part, fluid=True) for part in (*case.no_slip, "interface")),
        *(_process("apply_slip_process", part, fluid=True) for part in case.slip),
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
    """A Kratos process on a part of the fluid's boundary; ``fluid``: a process of the FluidDynamicsApplication."""
    application = "KratosMultiphysics.FluidDynamicsApplication" if fluid else "KratosMultiphysics"
    parameters = {"model_part_name": f"FluidModelPart.{part}", **settings}
    return {"python_module": module, "kratos_module": application, "Parameters": parameters}


def _structure(case: Case, end_time: float) -> Block:
    solver = {
        "solver_type": "dynamic",
        "echo_level": 0,
        "analysis_type": "non_linear",
        "time_integration_method": "implicit",
        "scheme_type": case.scheme,
        "model_part_name": "Structure",
        "domain_size": 2,
        "model_import_settings": {"input_type": "mdpa", "input_filename": "solid"},
        "material_import_settings": {"materials_filename": "materials.json"},
        "time_stepping": {"time_step": case.time_step},
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
            "model_part_name": "Structure.foot", "variable_name": "DISPLACEMENT", "constrained": [True] * 3,
            "value": [0.0] * 3, "interval": [0.0, "End"],
        },
    }  # fmt: skip
    return {
        "problem_data": _problem("solid", end_time),
        "solver_settings": solver,
        "processes": {"constraints_process_list": [clamp]},
        "output_processes": {},
    }
