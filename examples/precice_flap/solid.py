"""The tutorial's participant Solid: stock CalculiX by mesh_motion_calculix, without preCICE's adapter for it.

python solid.py precice-config.xml FOLDER
"""

from __future__ import annotations

import sys
from pathlib import Path

import precice
from mesh_motion_calculix import Solid, flap_deck

MESH = "Solid-Mesh"


def main(config: str, folder: Path) -> None:
    """Follow preCICE until it ends: a window that is not converged is computed again."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "flap.inp").write_text(flap_deck((2, 20)))
    participant = precice.Participant("Solid", config, 0, 1)
    with Solid(folder / "flap.inp", "INTERFACE", folder / "windows", dimensions=2) as solid:
        nodes = participant.set_mesh_vertices(MESH, solid.points)
        participant.initialize()
        while participant.is_coupling_ongoing():
            participant.requires_writing_checkpoint()  # the solid keeps its last accepted window itself
            dt = participant.get_max_time_step_size()
            forces = participant.read_data(MESH, "Force", nodes, dt)
            participant.write_data(MESH, "Displacement", nodes, solid.solve(forces, dt))
            participant.advance(dt)
            if not participant.requires_reading_checkpoint():
                solid.advance()
    participant.finalize()


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
