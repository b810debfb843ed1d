"""Stand-ins for a fluid and a solid code, as preCICE participants: python solvers.py Fluid|Solid.

The fluid's load depends on the flag's position in the *moved mesh*, the solid is a beam: the pair of examples/mock_fsi,
whose coupled motion is known. The fluid writes the deflection of the flag's tip, window by window, to tip.csv.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
import precice
from mesh_motion_client import Mesh

HERE = Path(__file__).resolve().parent
EXAMPLES = HERE.parents[2] / "examples"
sys.path.insert(0, str(EXAMPLES / "mock_fsi"))

from fluid import ROLES, LoadStub  # noqa: E402
from solid import Beam, Structure  # noqa: E402

DT = 0.05  # the window of precice-config.xml


def windows(coupling):
    """Yield number and end of the window in each iteration; the solver computes and writes, then preCICE advances."""
    coupling.initialize()
    window = 1
    while coupling.is_coupling_ongoing():
        coupling.requires_writing_checkpoint()  # the stand-ins change their state only when a window is complete
        step = coupling.get_max_time_step_size()
        yield window, step
        coupling.advance(step)
        if not coupling.requires_reading_checkpoint():
            window += 1
    coupling.finalize()


def fluid(config: str, out: Path) -> None:
    """Compute loads from the moved mesh; pass the solid's displacement on to the mesh motion."""
    mesh = Mesh.load(EXAMPLES / "turek_hron_flag" / "mesh.npz", ROLES)
    flag = mesh.patches["flag"].nodes
    load = LoadStub(mesh.points[flag], dt=DT, added_mass=20.0, amplitude=30.0, frequency=1.0)
    coupling = precice.Participant("Fluid", config, 0, 1)
    volume = coupling.set_mesh_vertices("Fluid-Volume-Mesh", mesh.points)
    wet = coupling.set_mesh_vertices("Fluid-Flag-Mesh", mesh.points[flag])
    tip, tips, last = int(np.argmax(mesh.points[flag, 0])), [], 0
    moved = np.zeros_like(mesh.points)
    for window, step in windows(coupling):
        if window > last + 1:  # the window before is complete: what was read in its last iteration is its end
            load.commit(moved[flag])
            tips, last = [*tips, moved[flag][tip, 1]], window - 1
        moved = coupling.read_data("Fluid-Volume-Mesh", "NodeDisplacement", volume, step)
        displacement = coupling.read_data("Fluid-Flag-Mesh", "SolidDisplacement", wet, step)
        coupling.write_data("Fluid-Flag-Mesh", "Force", wet, load.force(window * DT, moved[flag]))
        coupling.write_data("Fluid-Flag-Mesh", "Displacement", wet, displacement)
    tips.append(moved[flag][tip, 1])
    np.savetxt(out / "tip.csv", np.stack([DT * np.arange(1, len(tips) + 1), tips], axis=1), "%.9g", header="time tip")


def solid(config: str, _out: Path) -> None:
    """A beam on the flag's nodes."""
    mesh = Mesh.load(EXAMPLES / "turek_hron_flag" / "mesh.npz", ROLES)
    points = mesh.points[mesh.patches["flag"].nodes]
    beam = Structure(Beam(), points, DT)
    coupling = precice.Participant("Solid", config, 0, 1)
    wet = coupling.set_mesh_vertices("Solid-Flag-Mesh", points)
    last = 0
    for window, step in windows(coupling):
        if window > last + 1:
            beam.commit()
            last = window - 1
        force = coupling.read_data("Solid-Flag-Mesh", "Force", wet, step)
        coupling.write_data("Solid-Flag-Mesh", "SolidDisplacement", wet, beam.advance(force))


def main() -> int:
    """One of the two."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("participant", choices=["Fluid", "Solid"])
    parser.add_argument("--config", default="precice-config.xml")
    parser.add_argument("--out", type=Path, default=Path())
    options = parser.parse_args()
    {"Fluid": fluid, "Solid": solid}[options.participant](options.config, options.out)
    return 0


if __name__ == "__main__":
    sys.exit(main())
