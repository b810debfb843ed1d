"""Boundaries in a box for the tests of two scales: a body of given size and spacing, walls around it."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def sphere(count: int, radius: float, centre: float = 0.5) -> Floats:
    """(count, 3) nearly evenly spread points (Fibonacci's lattice)."""
    k = np.arange(count) + 0.5
    polar, turn = np.arccos(1.0 - 2.0 * k / count), np.pi * (1.0 + 5.0**0.5) * k
    unit = np.stack([np.cos(turn) * np.sin(polar), np.sin(turn) * np.sin(polar), np.cos(polar)], axis=1)
    return centre + radius * unit


def walls(count: int) -> Floats:
    """(6 count² …, 3) points on the unit cube's surface."""
    line = np.linspace(0.0, 1.0, count)
    grid = np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1).reshape(-1, 3)
    return grid[np.any((grid == 0.0) | (grid == 1.0), axis=1)]


def graded_circle(count: int, ratio: float) -> Floats:
    """(count, 2) points on a circle whose spacing varies by ``ratio``."""
    spacing = ratio ** (0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(count) / count))
    angle = 2.0 * np.pi * np.cumsum(spacing) / spacing.sum()
    return 0.5 + 0.1 * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def square(count: int) -> Floats:
    """(4 count − 4, 2) points on the unit square's rim."""
    line = np.linspace(0.0, 1.0, count)
    grid = np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1).reshape(-1, 2)
    return grid[np.any((grid == 0.0) | (grid == 1.0), axis=1)]


def boundary(body: Floats, rest: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """Control points, the body's first, and which of them move."""
    return np.vstack([body, rest]), np.arange(len(body) + len(rest)) < len(body)
