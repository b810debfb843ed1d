"""The solids of preCICE's tutorials: unmodified CalculiX, run by mesh_motion_calculix without preCICE's adapter.

python solid.py precice-config.xml PARTICIPANT FOLDER [tube.inp]
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import precice
from mesh_motion_calculix import Solid, flap_deck
from numpy.typing import NDArray

Floats = NDArray[np.float64]
#: The place (x) of each participant's flap.
FEET = {"Solid": 0.0, "Solid-Upstream": -1.0, "Solid-Downstream": 1.0}
#: Sides of a C3D10 in three triangles at the corners and one in the middle: its corners, and the nodes between them.
SIDES = [(0, 1, 2, 4, 5, 6), (0, 3, 1, 7, 8, 4), (1, 3, 2, 8, 9, 5), (2, 3, 0, 9, 7, 6)]
TRIANGLES = [(0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)]


def main(config: str, participant_name: str, folder: Path, deck: Path | None = None) -> None:
    """Follow preCICE until it ends the coupling; compute a window again if it has not converged."""
    folder.mkdir(parents=True, exist_ok=True)
    model = flap_deck((2, 20), foot=(FEET[participant_name], 0.0)) if deck is None else tube(deck)
    (folder / "model.inp").write_text(model)
    mesh, suffix = f"{participant_name}-Mesh", participant_name.removeprefix("Solid")
    participant = precice.Participant(participant_name, config, 0, 1)
    interface = "INTERFACE" if deck is None else "Ninterface"
    with Solid(folder / "model.inp", interface, folder / "windows", dimensions=2 if deck is None else 3) as solid:
        nodes = participant.set_mesh_vertices(mesh, solid.points)
        if deck is not None:  # nearest projection needs the surface
            participant.set_mesh_triangles(mesh, nodes[triangles(folder / "model.inp", solid.nodes)])
        lengths = np.ones((1, 1)) if not suffix else ring_lengths(solid.points)
        participant.initialize()
        while participant.is_coupling_ongoing():
            participant.requires_writing_checkpoint()  # the solid keeps its last accepted window itself
            dt = participant.get_max_time_step_size()
            forces = lengths * participant.read_data(mesh, f"Stress{suffix}" if suffix else "Force", nodes, dt)
            moved = solid.solve(forces, dt)
            if deck is None:
                participant.write_data(mesh, f"Displacement{suffix}", nodes, moved)
            else:
                participant.write_data(mesh, "DisplacementDelta", nodes, moved - solid.displacements)
            participant.advance(dt)
            if not participant.requires_reading_checkpoint():
                solid.advance()
    participant.finalize()


def ring_lengths(points: Floats) -> Floats:
    """(k, 1) half of the wetted sides at each node, m: factor from stresses to forces, for one metre of thickness."""
    x, y = points.T
    left, right, top = x == x.min(), x == x.max(), y == y.max()
    order = np.concatenate(
        [
            np.flatnonzero(left)[np.argsort(y[left])],
            np.flatnonzero(top & ~left & ~right)[np.argsort(x[top & ~left & ~right])],
            np.flatnonzero(right)[np.argsort(-y[right])],
        ]
    )
    sides = np.linalg.norm(np.diff(points[order], axis=0), axis=1)
    lengths = np.empty((len(points), 1))
    lengths[order, 0] = (np.append(sides, 0.0) + np.append(0.0, sides)) / 2
    return lengths


def tube(deck: Path) -> str:
    """The tutorial's model without its step; the step's fixed nodes become those of the model."""
    model = deck.read_text().partition("*STEP")[0]
    for name in ("all.msh", "inlet.nam", "outlet.nam", "interface.nam"):
        model = model.replace(f"*INCLUDE, INPUT={name}", (deck.parent / name).read_text().rstrip())
    kept = [line for line in model.splitlines() if not line.startswith("*INCLUDE")]  # the other sets are not used
    return "\n".join([*kept, "*BOUNDARY", "Ninlet, 1, 3", "Noutlet, 1, 3", ""])


def triangles(deck: Path, interface: NDArray[np.int64]) -> NDArray[np.int64]:
    """(m, 3) sides of second-order tetrahedra with all nodes on the interface, as rows of the interface's nodes."""
    lines = deck.read_text().partition("*ELEMENT")[2].splitlines()[1:]
    end = next(k for k, line in enumerate(lines) if line.startswith("*"))
    numbers = np.array(" ".join(lines[:end]).replace(",", " ").split(), dtype=np.int64).reshape(-1, 11)
    rows = np.full(max(int(numbers[:, 1:].max()), int(interface.max()) + 1), -1)
    rows[interface] = np.arange(len(interface))
    found = []
    for side in SIDES:
        nodes = rows[numbers[:, 1:][:, side] - 1]
        found += [nodes[(nodes >= 0).all(axis=1)][:, corners] for corners in TRIANGLES]
    return np.concatenate(found)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], Path(sys.argv[3]), *map(Path, sys.argv[4:]))
