"""Turek and Hron's flag behind a cylinder: OpenFOAM, CalculiX and the mesh-motion server, coupled implicitly.

    python examples/turek_hron_fsi/turek.py fsi3 --out out/fsi3                       strongly coupled: 5.3 Hz, ± 34 mm
    python examples/turek_hron_fsi/turek.py fsi2 --out out/fsi2                       wide: 2 Hz, ± 80 mm
    python examples/turek_hron_fsi/turek.py fsi2 --out out/own --motion laplacian     OpenFOAM's own mesh motion

A stopped run continues when it is started again with the same options.

S. Turek, J. Hron, Proposal for numerical benchmarking of fluid-structure interaction between an elastic object and
laminar incompressible flow, Lecture Notes in Computational Science and Engineering 53 (2006) 371-385.
"""

from __future__ import annotations

import argparse
import math
import sys
from dataclasses import dataclass
from pathlib import Path

from channel import DEPTH, FLAG, block_mesh
from mesh_motion_calculix import CalculixError, Solid, flap_deck
from mesh_motion_client.embedded import EmbeddedServer
from mesh_motion_fsi import Coupling, FsiError, OpenFoam, QuasiNewton, Row, Settings
from mesh_motion_fsi.case import build_library, environment, make_case, mesh_motion

HERE = Path(__file__).resolve().parent
ADAPTER = HERE.parents[1] / "adapters" / "openfoam"


@dataclass(frozen=True)
class Case:
    """A case of the benchmark, in SI units."""

    inflow: float  #: mean velocity of the inflow
    frequency: float  #: at which the flag swings, about
    density: float  #: the flag's
    young: float
    dt: float
    end: float  #: some periods after the oscillation has stopped growing


CASES = {
    "fsi2": Case(inflow=1.0, frequency=1.9, density=1e4, young=1.4e6, dt=4e-3, end=15.0),
    "fsi3": Case(inflow=2.0, frequency=5.3, density=1e3, young=5.6e6, dt=2e-3, end=8.0),
}


def report(row: Row, windows: int) -> None:
    """A line of progress."""
    sys.stdout.write(
        f"window {row.window:4d}/{windows}  t = {row.time:6.3f} s  A {1e3 * row.x:+8.3f} {1e3 * row.y:+8.3f} mm  "
        f"{row.iterations:2d} iterations  {row.seconds:5.2f} s\n"
    )
    sys.stdout.flush()


def run(options: argparse.Namespace) -> list[Row]:
    """Make the coupled run; return its history."""
    out: Path = options.out.resolve()
    case = CASES[options.case]
    out.mkdir(parents=True, exist_ok=True)
    build_library(ADAPTER)
    files = {
        "system/blockMeshDict": block_mesh(options.refinement),
        "system/inflow": f"mean       {case.inflow!r};\nfrequency  {case.frequency!r};\n",
    }
    make_case(HERE / "fluid", out / "fluid", options.motion, ADAPTER, files)
    (root, middle), length, width = FLAG
    deck = flap_deck(
        (2, 36), width=width, height=length, thickness=DEPTH, foot=(root, middle), axis=(1.0, 0.0),
        density=case.density, young=case.young, poisson=0.4,
    )  # fmt: skip
    (out / "flag.inp").write_text(deck)
    dt = options.dt or case.dt
    windows = math.ceil((options.end or case.end) / dt - 1e-9)
    settings = Settings(windows, dt, tolerance=options.tolerance, watch=(root + length, middle))
    with (
        mesh_motion(
            options.motion, options.server, lambda: EmbeddedServer(out / "server", 120.0, ["--threads", "1"])
        ) as server,
        Solid(out / "flag.inp", "INTERFACE", out / "solid", dimensions=2) as solid,
        OpenFoam(out / "fluid", environment=environment(ADAPTER) | server) as fluid,
    ):
        return Coupling(fluid, solid, QuasiNewton(), settings, out).run(lambda row: report(row, windows))


def arguments(given: list[str] | None = None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("case", choices=sorted(CASES))
    parser.add_argument("--out", type=Path, required=True, help="the run's folder; an existing run is continued")
    parser.add_argument(
        "--refinement", type=float, default=1.0, help="factor of the cells in each direction; 1: 13 000 cells"
    )
    parser.add_argument("--dt", type=float, help="time step, s; default: the case's")
    parser.add_argument("--end", type=float, help="end time, s; default: the case's")
    parser.add_argument(
        "--motion", choices=("server", "laplacian"), default="server", help="program that moves the mesh"
    )
    parser.add_argument("--server", help="endpoint of a mesh-motion server; default: a private one")
    parser.add_argument("--tolerance", type=float, default=3e-5, help="residual relative to the displacements")
    return parser.parse_args(given)


def main() -> int:
    """Run the case; status 1 with one line if it cannot continue."""
    try:
        run(arguments())
    except (FsiError, CalculixError) as error:
        sys.stderr.write(f"{error}\n")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
