"""The best motion of a 1D mesh: between two held nodes every cell is stretched equally.

The cells between two held nodes together absorb the change of their distance, so the smallest min(τ, 1/τ) is largest
when all τ are equal.
"""

import numpy as np

from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.correction.trial_nodes import TrialMesh
from mesh_motion_numerics.quality.metrics import sizes_of


def equal_stretch(points: Floats, mesh: TrialMesh) -> Floats:
    """Positions (n, 1) of all nodes; the held nodes have their positions in ``points`` (n, 1).

    A node beyond the last held node of its chain keeps its reference distance from it.
    """
    moved = points.copy()
    for chain, places in _chains(mesh):
        held = np.flatnonzero(mesh.held[chain])
        if len(held) == 0:
            continue
        x, y = places[held], points[chain[held], 0]
        inside = np.interp(places, x, y)
        beyond = np.minimum(places - x[0], 0.0) + np.maximum(places - x[-1], 0.0)
        free = ~mesh.held[chain]
        moved[chain[free], 0] = (inside + beyond)[free]
    return moved


def _chains(mesh: TrialMesh) -> list[tuple[Integers, Floats]]:
    """Connected chains of nodes, and the positions of their nodes as sums of reference sizes."""
    nodes = np.concatenate([block.nodes for block in mesh.cells])
    order = np.argsort(mesh.reference[nodes[:, 0], 0], kind="stable")
    nodes, sizes = nodes[order], sizes_of(mesh.reference_sizes)[order]
    breaks = np.flatnonzero(nodes[1:, 0] != nodes[:-1, 1]) + 1
    chains = []
    for part, lengths in zip(np.split(nodes, breaks), np.split(sizes, breaks), strict=True):
        chains.append((np.append(part[:, 0], part[-1, 1]), np.append(0.0, np.cumsum(lengths))))
    return chains
