"""Boundaries in a box for the tests of two scales: a body of given size and spacing, walls around it."""

import numpy as np
from frame_meshes import tensor_grid
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def sphere(count: int, radius: float, centre: float = 0.5) -> Floats:
    """(count, 3) nearly evenly spread points (Fibonacci's lattice)."""
    k = np.arange(count) + 0.5
    polar, turn = np.arccos(1.0 - 2.0 * k / count), np.pi * (1.0 + 5.0**0.5) * k
    unit = np.stack([np.cos(turn) * np.sin(polar), np.sin(turn) * np.sin(polar), np.cos(polar)], axis=1)
    return centre + radius * unit


def walls(count: int, d: int = 3) -> Floats:
    """Points on the surface of the unit cube, ``count`` along an edge, or on the rim of the unit square."""
    grid, _ = tensor_grid(*[np.linspace(0.0, 1.0, count)] * d)
    return grid[np.any((grid == 0.0) | (grid == 1.0), axis=1)]


def graded_sphere(count: int, ratio: float) -> Floats:
    """(count, 3) points on a sphere whose spacing varies by ``ratio`` from pole to pole."""
    k = (np.arange(count) + 0.5) / count
    height = np.linspace(-1.0, 1.0, 20_001)  # a band of height dz holds points in proportion to dz / spacing²
    density = ratio ** -(height + 1.0)
    total = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]) * np.diff(height))])
    z = np.interp(k, total / total[-1], height)
    turn = np.pi * (1.0 + 5.0**0.5) * np.arange(count)
    flat = np.sqrt(1.0 - z**2)
    return 0.5 + 0.1 * np.stack([np.cos(turn) * flat, np.sin(turn) * flat, z], axis=1)


def graded_circle(count: int, ratio: float) -> Floats:
    """(count, 2) points on a circle whose spacing varies by ``ratio``."""
    spacing = ratio ** (0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(count) / count))
    angle = 2.0 * np.pi * np.cumsum(spacing) / spacing.sum()
    return 0.5 + 0.1 * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def boundary(body: Floats, rest: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """Control points, the body's first, and which of them move."""
    return np.vstack([body, rest]), np.arange(len(body) + len(rest)) < len(body)
