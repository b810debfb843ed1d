"""Parts of a boundary that are inside out, in 2D and 3D; parts that are rotated, moved or open are not."""

from typing import Any

import numpy as np
import pytest
from mesh_motion_numerics.mesh.boundary_orientation import overturned_place

SQUARE = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
RIM = np.array([[0, 1], [1, 2], [2, 3], [3, 0]])
CUBE = np.array([(x, y, z) for z in (0.0, 1.0) for y in (0.0, 1.0) for x in (0.0, 1.0)])
FACES = np.array([[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]])
HALVES = np.concatenate([FACES[1:][:, [0, 1, 2]], FACES[1:][:, [0, 2, 3]]])


def both(points: Any, facets: dict[str, Any]) -> tuple[Any, dict[str, Any]]:
    n = len(points)
    return np.concatenate([points, points + 9.0]), {k: np.concatenate([f, f + n]) for k, f in facets.items()}


@pytest.mark.parametrize(
    ("points", "facets"),
    [(SQUARE, {"line": RIM}), (CUBE, {"quad": FACES}), (CUBE, {"quad": FACES[:1], "triangle": HALVES})],
)
@pytest.mark.parametrize("hole", [False, True])
def test_a_mirrored_part_is_found_and_a_turned_one_is_not(points: Any, facets: dict[str, Any], hole: bool) -> None:
    facets = {kind: nodes[:, ::-1] if hole else nodes for kind, nodes in facets.items()}
    reference, whole = both(points, facets)
    prescribed = np.ones(len(reference), dtype=bool)
    n = len(points)
    turned = reference.copy()
    turned[n:] = 3.0 + points * np.array([-2.0, -3.0, 1.0])[: points.shape[1]]
    assert overturned_place(whole, prescribed, reference, turned) is None
    mirrored = reference.copy()
    mirrored[n:, 0] = 19.0 - mirrored[n:, 0]
    place = overturned_place(whole, prescribed, reference, mirrored)
    np.testing.assert_allclose(place, 9.5)
    prescribed[-1] = False
    assert overturned_place(whole, prescribed, reference, mirrored) is None


def test_a_collapsed_part_is_found() -> None:
    assert overturned_place({"line": RIM}, np.ones(4, dtype=bool), SQUARE, SQUARE * [1.0, 0.0]) is not None


def test_a_baffle_may_turn_and_open_but_its_sides_do_not_change_places() -> None:
    """Nodes 0 to 3 along the lower side, 4 and 5 back along the upper side."""
    reference = np.array([[0.3, 0.5], [0.4, 0.5], [0.6, 0.5], [0.7, 0.5], [0.6, 0.5], [0.4, 0.5]])
    hole = {"line": np.array([[1, 0], [2, 1], [3, 2], [4, 3], [5, 4], [0, 5]])}
    prescribed = np.ones(6, dtype=bool)
    for angle in np.linspace(0.1, 3.0, 20):
        turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        assert overturned_place(hole, prescribed, reference, reference @ turn) is None
    opened = reference + np.array([[0, 0], [0, -0.1], [0, -0.1], [0, 0], [0, 0.1], [0, 0.1]])
    assert overturned_place(hole, prescribed, reference, opened) is None
    np.testing.assert_allclose(overturned_place(hole, prescribed, reference, opened * [1.0, -1.0]), [0.5, -0.5])


def test_in_1d_there_is_nothing_to_turn() -> None:
    ends = np.array([[0.0], [1.0]])
    assert overturned_place({"vertex": np.array([[0], [1]])}, np.ones(2, dtype=bool), ends, -ends) is None
