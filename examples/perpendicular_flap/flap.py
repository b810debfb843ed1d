"""The perpendicular flap: OpenFOAM, CalculiX and the mesh-motion server, coupled implicitly.

    python examples/perpendicular_flap/flap.py --out out/flap                        the benchmark, 500 windows
    python examples/perpendicular_flap/flap.py --out out/laplacian --motion laplacian   OpenFOAM's own mesh motion
    python examples/perpendicular_flap/flap.py --out out/soft --young 2e5            a softer flap

A stopped run continues when it is started again with the same options.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from mesh_motion_calculix import CalculixError, Solid, flap_deck
from mesh_motion_client.embedded import EmbeddedServer
from mesh_motion_fsi import ACCELERATIONS, Coupling, FsiError, OpenFoam, Row, Settings
from mesh_motion_fsi.case import build_library, environment, make_case, mesh_motion

HERE = Path(__file__).resolve().parent
ADAPTER = HERE.parents[1] / "adapters" / "openfoam"


def report(row: Row, windows: int) -> None:
    """A line of progress."""
    sys.stdout.write(
        f"window {row.window:4d}/{windows}  t = {row.time:6.3f} s  tip {row.x:+.5f} m  {row.iterations:2d} iterations  "
        f"{row.seconds:5.2f} s\n"
    )
    sys.stdout.flush()


def run(options: argparse.Namespace) -> list[Row]:
    """Make the coupled run; return its history."""
    out: Path = options.out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    build_library(ADAPTER)
    factors = f'relaxationFactors {{ equations {{ "U.*" {options.relaxation!r}; }} }}\n'
    files = {"system/relaxation": factors} if options.relaxation < 1.0 else {}
    make_case(HERE / "fluid", out / "fluid", options.motion, ADAPTER, files)
    (out / "flap.inp").write_text(flap_deck((2, 20), young=options.young))
    settings = Settings(options.windows, options.dt, tolerance=options.tolerance)
    with (
        mesh_motion(
            options.motion, options.server, lambda: EmbeddedServer(out / "server", 120.0, ["--threads", "1"])
        ) as server,
        Solid(out / "flap.inp", "INTERFACE", out / "solid", dimensions=2) as solid,
        OpenFoam(out / "fluid", environment=environment(ADAPTER) | server) as fluid,
    ):
        coupling = Coupling(fluid, solid, ACCELERATIONS[options.acceleration](), settings, out)
        return coupling.run(lambda row: report(row, options.windows))


def arguments(given: list[str] | None = None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "--out", type=Path, default=Path("out/flap"), help="the run's folder; an existing run is continued"
    )
    parser.add_argument("--windows", type=int, default=500)
    parser.add_argument("--dt", type=float, default=0.01, help="s")
    parser.add_argument("--young", type=float, default=4e6, help="Pa")
    parser.add_argument(
        "--motion", choices=("server", "laplacian"), default="server", help="program that moves the mesh"
    )
    parser.add_argument("--relaxation", type=float, default=1.0, help="relaxation factor of the momentum equation")
    parser.add_argument("--server", help="endpoint of a mesh-motion server; default: a private one")
    parser.add_argument("--acceleration", choices=sorted(ACCELERATIONS), default="iqn-ils")
    parser.add_argument("--tolerance", type=float, default=1e-3, help="residual relative to the displacements")
    return parser.parse_args(given)


def main() -> int:
    """Run the case; status 1 with one line if it cannot continue."""
    options = arguments()
    try:
        run(options)
    except (FsiError, CalculixError) as error:
        sys.stderr.write(f"{error}\n")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
