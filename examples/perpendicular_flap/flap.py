"""The perpendicular flap: OpenFOAM, CalculiX and the mesh-motion server, coupled implicitly.

    python examples/perpendicular_flap/flap.py --out out/flap                        the benchmark, 500 windows
    python examples/perpendicular_flap/flap.py --out out/laplacian --motion laplacian   OpenFOAM's own mesh motion
    python examples/perpendicular_flap/flap.py --out out/soft --young 2e5            a softer flap

A run that was stopped goes on where it was when it is started again with the same options.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mesh_motion_calculix import CalculixError, Solid, flap_deck
from mesh_motion_client.embedded import EmbeddedServer
from mesh_motion_fsi import ACCELERATIONS, Coupling, FsiError, OpenFoam, Row, Settings

HERE = Path(__file__).resolve().parent
ADAPTER = HERE.parents[1] / "adapters" / "openfoam"


def environment() -> dict[str, str]:
    """What Debian's OpenFOAM needs, and where the adapter's library is."""
    root = os.environ.get("WM_PROJECT_DIR", "/usr/share/openfoam")
    path = f"{ADAPTER / 'build'}:{os.environ.get('LD_LIBRARY_PATH', '')}"
    return {"WM_PROJECT_DIR": root, "FOAM_ETC": os.environ.get("FOAM_ETC", f"{root}/etc"), "LD_LIBRARY_PATH": path}


def build() -> None:
    """The library for OpenFOAM, which takes a moment where it is built already."""
    if shutil.which("pimpleFoam") is None:
        raise FsiError("OpenFOAM is not installed", "Debian: apt-get install openfoam")
    if (ADAPTER / "build" / "libremoteMeshMotion.so").exists() and not (ADAPTER / "Allwmake").exists():
        return  # an image that runs holds no sources
    done = subprocess.run([ADAPTER / "Allwmake"], capture_output=True, text=True, check=False)
    if done.returncode:
        raise FsiError(f"{ADAPTER / 'Allwmake'} failed: {done.stderr.strip()[-500:]}")


def make_case(folder: Path, motion: str, relaxation: float = 1.0) -> None:
    """The fluid's case with its mesh; one that is there already is left as it is."""
    if (folder / "constant" / "polyMesh" / "points").exists():
        return
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(HERE / "fluid", folder)
    if motion == "laplacian":
        (folder / "constant" / "dynamicMeshDict.laplacian").replace(folder / "constant" / "dynamicMeshDict")
    if relaxation < 1.0:
        factors = f'relaxationFactors {{ equations {{ "U.*" {relaxation!r}; }} }}\n'
        (folder / "system" / "relaxation").write_text(factors)
    done = subprocess.run(
        ["blockMesh"], cwd=folder, env=os.environ | environment(), capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise FsiError(f"blockMesh failed: {done.stdout[-500:]}{done.stderr[-500:]}")


@contextmanager
def mesh_motion(motion: str, endpoint: str | None, state: Path) -> Iterator[dict[str, str]]:
    """The server's address for the fluid: a given one, a private one, or none for the control."""
    if motion == "laplacian" or endpoint:
        yield {"MESH_MOTION_ENDPOINT": endpoint or ""}
        return
    server = EmbeddedServer(state, 120.0, ["--threads", "1"])
    try:
        yield {"MESH_MOTION_ENDPOINT": server.endpoint}
    finally:
        server.stop()


def tell(row: Row, windows: int) -> None:
    """A line of progress."""
    sys.stdout.write(
        f"window {row.window:4d}/{windows}  t = {row.time:6.3f} s  tip {row.x:+.5f} m  {row.iterations:2d} iterations  "
        f"{row.seconds:5.2f} s\n"
    )
    sys.stdout.flush()


def run(options: argparse.Namespace) -> list[Row]:
    """The coupled run; its history."""
    out: Path = options.out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    build()
    make_case(out / "fluid", options.motion, options.relaxation)
    (out / "flap.inp").write_text(flap_deck((2, 20), young=options.young))
    settings = Settings(options.windows, options.dt, tolerance=options.tolerance)
    with (
        mesh_motion(options.motion, options.server, out / "server") as server,
        Solid(out / "flap.inp", "INTERFACE", out / "solid", dimensions=2) as solid,
        OpenFoam(out / "fluid", environment=environment() | server) as fluid,
    ):
        coupling = Coupling(fluid, solid, ACCELERATIONS[options.acceleration](), settings, out)
        return coupling.run(lambda row: tell(row, options.windows))


def arguments(given: list[str] | None = None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out/flap"), help="the run's folder; a run is gone on with")
    parser.add_argument("--windows", type=int, default=500)
    parser.add_argument("--dt", type=float, default=0.01, help="s")
    parser.add_argument("--young", type=float, default=4e6, help="Pa")
    parser.add_argument("--motion", choices=("server", "laplacian"), default="server", help="who moves the mesh")
    parser.add_argument("--relaxation", type=float, default=1.0, help="of the momentum equation, in all correctors")
    parser.add_argument("--server", help="endpoint of a mesh-motion server; default: a private one")
    parser.add_argument("--acceleration", choices=sorted(ACCELERATIONS), default="iqn-ils")
    parser.add_argument("--tolerance", type=float, default=1e-3, help="residual relative to the displacements")
    return parser.parse_args(given)


def main() -> int:
    """Run it; status 1 with one line where it cannot go on."""
    options = arguments()
    try:
        run(options)
    except (FsiError, CalculixError) as error:
        sys.stderr.write(f"{error}\n")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
