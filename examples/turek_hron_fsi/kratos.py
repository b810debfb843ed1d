"""Turek and Hron's FSI2 and FSI3 in Kratos Multiphysics: its fluid, its solid, its coupling, and the server.

    python examples/turek_hron_fsi/kratos.py fsi2 --out out/kratos              Kratos and the server
    python examples/turek_hron_fsi/kratos.py fsi2 --out out/own --motion own    Kratos' structural_similarity

Linear triangles (variational multiscale) for the flow, quadratic quadrilaterals (Total Lagrangian) for the flag. A
stopped run continues when it is started again with the same options.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
from channel import FLAG
from mok_benchmark.execution import History, RunFailed, compute, missing_kratos, watch
from mok_benchmark.meshes import FluidMesh, fluid_mesh, write_fluid, write_solid
from mok_benchmark.parameters import MESH_SOLVERS, Case, materials
from turek import CASES

_LENGTH, _HEIGHT, _CENTRE, _RADIUS = 2.5, 0.41, (0.2, 0.2), 0.05
_RAMP = 2.0  # s, in which the inflow is raised
_STEP_AND_END = {"fsi2": (0.01, 11.0), "fsi3": (0.004, 5.0)}  # s; some fifty steps of a period
MOTIONS = dict(zip(("own", "server"), MESH_SOLVERS, strict=True))


def kratos_case(name: str, time_step: float) -> Case:
    """The channel; the increasing inflow is tilted with the flag's frequency, so that the flag swings earlier."""
    parabola = f"{6.0 * CASES[name].inflow / _HEIGHT**2!r}*y*({_HEIGHT}-y)"
    tilt = f"(1+0.3*sin(2*pi*{CASES[name].frequency}*t)*sin(pi*t/{_RAMP})*(y/{_HEIGHT / 2.0}-1))"
    rising = f"{parabola}*{tilt}*(1-cos(pi*t/{_RAMP}))/2"
    return Case(
        no_slip=("walls", "cylinder"), slip=(), inflow=((rising, (0.0, _RAMP)), (parabola, (_RAMP, "End"))),
        time_step=time_step, tolerance=3e-5, scheme="bossak",  # with newmark accelerations alternate, until it fails
    )  # fmt: skip


def flag_mesh(along: int, across: int, coarsest: float) -> FluidMesh:
    """Triangles of the channel, graded from the flag with ``along`` edges on a side and ``across`` at its end."""

    def geometry(gmsh: Any) -> dict[str, list[int]]:
        """Make the channel in Gmsh's model; return its lines by part."""
        (root, middle), length, width = FLAG
        finest, half = length / along, width / 2.0
        geo = gmsh.model.geo
        corners = ((0.0, 0.0), (_LENGTH, 0.0), (_LENGTH, _HEIGHT), (0.0, _HEIGHT))
        box = [geo.addPoint(x, y, 0.0) for x, y in corners]
        flag = [geo.addPoint(root + x, middle + y, 0.0) for x, y in ((0, -half), (length, -half), (length, half))]
        centre, x, y = geo.addPoint(*_CENTRE, 0.0), *_CENTRE
        round_it = [geo.addPoint(*at, 0.0) for at in ((x, y + _RADIUS), (x - _RADIUS, y), (x, y - _RADIUS))]
        ring = [geo.addPoint(root, middle + half, 0.0), *round_it, flag[0]]
        bottom, outlet, top, inlet = (geo.addLine(box[i], box[(i + 1) % 4]) for i in range(4))
        sides = [geo.addLine(flag[0], flag[1]), geo.addLine(flag[1], flag[2]), geo.addLine(flag[2], ring[0])]
        arcs = [geo.addCircleArc(ring[i], centre, ring[i + 1]) for i in range(4)]
        geo.addPlaneSurface([geo.addCurveLoop([bottom, outlet, top, inlet]), geo.addCurveLoop([*sides, *arcs])])
        for line, count in zip(sides, (along, across, along), strict=True):
            geo.mesh.setTransfiniteCurve(line, count + 1)
        for arc in arcs:
            geo.mesh.setTransfiniteCurve(arc, round(math.pi / 2.0 * _RADIUS / (0.8 * finest)) + 1)
        geo.synchronize()
        field = gmsh.model.mesh.field
        field.add("Distance", 1)
        field.setNumbers(1, "CurvesList", [*sides, *arcs])
        field.setNumber(1, "Sampling", 200)
        field.add("Threshold", 2)
        sizes = {"InField": 1, "SizeMin": finest, "SizeMax": coarsest, "DistMin": 0.04, "DistMax": 0.6}
        for name, value in sizes.items():
            field.setNumber(2, name, value)
        field.setAsBackgroundMesh(2)
        for option in ("ExtendFromBoundary", "FromPoints", "FromCurvature"):
            gmsh.option.setNumber(f"Mesh.MeshSize{option}", 0)
        return {"inlet": [inlet], "outlet": [outlet], "walls": [bottom, top], "cylinder": arcs, "interface": sides}

    return fluid_mesh(geometry)


def prepare(folder: Path, name: str, elements: tuple[int, int], coarsest: float) -> FluidMesh:
    """Write meshes and material of a case; ``elements`` of the flag along and across it."""
    folder.mkdir(parents=True, exist_ok=True)
    along, across = elements
    mesh = flag_mesh(2 * along, 2 * across, coarsest)
    write_fluid(folder / "fluid.mdpa", mesh, {"DENSITY": 1e3, "DYNAMIC_VISCOSITY": 1.0})
    (root, middle), length, width = FLAG
    x = root + np.linspace(0.0, length, 2 * along + 1)
    y = middle + width * np.linspace(0.5, -0.5, 2 * across + 1)
    solid = write_solid(folder / "solid.mdpa", np.stack(np.broadcast_arrays(x[:, None], y), axis=-1))
    case = CASES[name]
    (folder / "materials.json").write_text(json.dumps(materials("Strain", case.density, case.young, 0.4)))
    watch(folder, solid, [(root + length, middle)], ["interface", "cylinder"], meshes=False)
    return mesh


def run(options: argparse.Namespace) -> History:
    """The coupled run; its history.

    Raises
    ------
    RunFailed
        The run did not reach its end, or Kratos is not installed.
    """
    missing = missing_kratos()
    if missing:
        raise RunFailed(missing)
    step, end = _STEP_AND_END[options.case]
    mesh = prepare(options.out, options.case, (options.elements, 2), options.coarsest)
    sys.stdout.write(f"{len(mesh.points)} nodes, {len(mesh.triangles)} triangles\n")
    case = kratos_case(options.case, options.dt or step)
    return compute(options.out, case, MOTIONS[options.motion], options.end or end, report)


def report(done: int, steps: int) -> None:
    """Print a line of progress from time to time."""
    if done % 25 == 0:
        sys.stdout.write(f"step {done} of {steps}\n")
        sys.stdout.flush()


def arguments(given: list[str] | None = None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("case", choices=sorted(_STEP_AND_END))
    parser.add_argument("--out", type=Path, required=True, help="the run's folder; an existing run is continued")
    parser.add_argument(
        "--elements", type=int, default=32, help="elements along the flag; the fluid has two edges for each"
    )
    parser.add_argument("--coarsest", type=float, default=0.035, help="edge length far from the flag, m")
    parser.add_argument("--dt", type=float, help="s; 0.01 in FSI2, 0.004 in FSI3")
    parser.add_argument("--end", type=float, help="s; 11 in FSI2, 5 in FSI3")
    parser.add_argument("--motion", choices=sorted(MOTIONS), default="server", help="program that moves the mesh")
    return parser.parse_args(given)


def main() -> int:
    """Run the case; status 1 with a line if it cannot continue."""
    try:
        run(arguments())
    except RunFailed as error:
        sys.stderr.write(f"{error}\n")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
