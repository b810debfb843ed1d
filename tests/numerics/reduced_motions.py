"""Boundary motions for the tests of point reductions: a slab in a square, and a wing that bends and twists in a box."""

from functools import cache

import numpy as np
from correction_cases import rigid, stored
from mesh_motion_numerics.reduction import ReductionProblem
from mesh_motion_numerics.reduction.problem import Reduced


@cache
def slab() -> tuple[np.ndarray, np.ndarray]:
    """Boundary (104, 2) of the thesis' slab in a square, translated and rotated by 60 degrees."""
    mesh = stored("correction_slab")
    return mesh.points[mesh.held], rigid(mesh, (-0.2, -0.2), 60.0)[mesh.held]


@cache
def wing() -> tuple[np.ndarray, np.ndarray]:
    """(1100, 3) nodes: the surface of a wing of span 0.4 with finer sections at its tip, and six walls."""
    along, around = np.meshgrid(np.linspace(0.0, 1.0, 25) ** 0.7, np.linspace(0.0, 2 * np.pi, 20, endpoint=False))
    t, angle = along.ravel(), around.ravel()
    body = np.column_stack([0.5 + 0.1 * np.cos(angle), 0.5 + 0.02 * np.sin(angle), 0.3 + 0.4 * t])
    u, v = (x.ravel() for x in np.meshgrid((np.arange(10) + 0.5) / 10, (np.arange(10) + 0.5) / 10))
    walls = [np.insert(np.column_stack([u, v]), axis, side, axis=1) for axis in range(3) for side in (0.0, 1.0)]
    moved = np.zeros_like(body)
    twist = np.deg2rad(25.0) * t**2
    moved[:, 0] = (body[:, 0] - 0.5) * (np.cos(twist) - 1.0)
    moved[:, 1] = (body[:, 0] - 0.5) * np.sin(twist) + 0.08 * t**2 * (3.0 - t)
    return np.concatenate([body, *walls]), np.concatenate([moved, np.zeros((600, 3))])


BOUNDARIES = {"slab": (slab, 0.5), "wing": (wing, 0.8)}
"""Nodes and displacement by name, and a support radius."""


def problem(name: str, **choices: object) -> ReductionProblem:
    boundary, radius = BOUNDARIES[name]
    return ReductionProblem(*boundary(), **{"support_radius": radius, **choices})


def field_at_nodes(reduced: Reduced, of: ReductionProblem) -> np.ndarray:
    """(nb, k) values at the boundary nodes from dense matrices of φ: no layout, no cells."""
    total = np.zeros_like(of.displacement)
    for level in reduced.levels:
        r = np.linalg.norm(of.points[:, None] - level.control_points, axis=2) / level.support_radius
        total += (np.maximum(0.0, 1.0 - r) ** 4 * (4.0 * r + 1.0)) @ level.weights
    return total
