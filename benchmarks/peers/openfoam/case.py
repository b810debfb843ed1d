"""A moveDynamicMesh case: the mesh, the prescribed boundary displacements and the solver's settings.

The boundary condition ``uniformInterpolatedDisplacement`` reads the displacement of the boundary from one field for
each step, so any motion can be prescribed. All entries that :class:`Settings` does not set have the usual values of
OpenFOAM cases.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from mesh_motion_numerics.mesh.cells import CellTable

from benchmarks.peers.openfoam.foam_files import write_dictionary, write_point_field, write_polymesh
from benchmarks.peers.openfoam.polymesh import PolyMesh
from benchmarks.peers.task import Task

__all__ = ["TOLERANCES", "Settings", "write_case"]

#: The residual is normalised by the huge coefficients next to the wall, so that the usual tolerance stops after an
#: iteration or two with the interior far from harmonic. At least thirty iterations bring the tetrahedra of M3 to within
#: 1e-4 of the solution after 150, the hexahedra of H1 to 1e-8 (five: 1e-2 and 1e-3).
TOLERANCES = {
    "usual": "tolerance 1e-5; relTol 0;",
    "converged": "tolerance 1e-8; relTol 0; minIter 30;",
}


@dataclass(frozen=True)
class Settings:
    """Settings of the solver displacementLaplacian.

    Attributes
    ----------
    diffusivity : str
        As in dynamicMeshDict; the moving patch is called ``moving``.
    tolerance : {"usual", "converged"}
        See :data:`TOLERANCES`.
    laplacian : {"corrected", "uncorrected"}
        The non-orthogonal part of the gradients is explicit, from the displacement before the step: most decks ask for
        it, but in one large step it is that of a field that jumps at the wall, and leaving it out does better.
    """

    diffusivity: str = "quadratic inverseDistance (moving)"
    tolerance: str = "converged"
    laplacian: str = "corrected"


_PRESCRIBED = "prescribedDisplacement"

_CONTROL = """application moveDynamicMesh;
startFrom startTime;
startTime 0;
stopAt endTime;
endTime {steps};
deltaT 1;
writeControl timeStep;
writeInterval 1;
writeFormat binary;
writePrecision 16;
writeCompression off;
timeFormat general;
timePrecision 6;
runTimeModifiable false;
libs ("libfvMotionSolvers.so");
"""
_SCHEMES = """ddtSchemes {{ default Euler; }}
gradSchemes {{ default Gauss linear; }}
divSchemes {{ default none; }}
laplacianSchemes {{ default Gauss linear {laplacian}; }}
interpolationSchemes {{ default linear; }}
snGradSchemes {{ default {laplacian}; }}
"""
_MOTION = """dynamicFvMesh dynamicMotionSolverFvMesh;
motionSolverLibs ("libfvMotionSolvers.so");
motionSolver displacementLaplacian;
displacementLaplacianCoeffs {{ diffusivity {diffusivity}; }}
"""


def write_case(task: Task, case: Path, settings: Settings) -> PolyMesh:
    """Write the case; return the mesh, because it maps points back to nodes.

    Parameters
    ----------
    case : Path
        Folder of the case.
    """
    mesh = PolyMesh.from_cells(
        task.points, CellTable.from_arrays(task.cells), {"moving": task.moving, "fixed": task.fixed}
    )
    write_polymesh(mesh, case)
    write_dictionary(case, "system", "controlDict", _CONTROL.format(steps=task.steps))
    write_dictionary(case, "system", "fvSchemes", _SCHEMES.format(laplacian=settings.laplacian))
    solver = f"solver GAMG; smoother GaussSeidel; {TOLERANCES[settings.tolerance]}"
    write_dictionary(case, "system", "fvSolution", f'solvers\n{{\n    "cellDisplacement.*" {{ {solver} }}\n}}\n')
    write_dictionary(case, "constant", "dynamicMeshDict", _MOTION.format(diffusivity=settings.diffusivity))
    _write_displacements(task, mesh, case)
    return mesh


def _write_displacements(task: Task, mesh: PolyMesh, case: Path) -> None:
    """The unknown with its boundary conditions, and the prescribed field at every step."""
    names = [patch.name for patch in mesh.patches if patch.kind == "empty"]
    empty = dict.fromkeys(names, "type empty;")
    prescribed = f"type uniformInterpolatedDisplacement; field {_PRESCRIBED}; interpolationScheme linear;"
    unknown = {
        "moving": f"{prescribed} value uniform (0 0 0);",
        "fixed": "type fixedValue; value uniform (0 0 0);",
        **empty,
    }
    read = {"moving": "type calculated;", "fixed": "type calculated;", **empty}
    values = mesh.point_values(0.0 * task.points)
    write_point_field(case, 0, "pointDisplacement", values, unknown)
    write_point_field(case, 0, _PRESCRIBED, values, read)
    for step in range(task.steps):
        displacement = 0.0 * task.points
        displacement[task.moving] = task.displacements[step]
        write_point_field(case, step + 1, _PRESCRIBED, mesh.point_values(displacement), read)
