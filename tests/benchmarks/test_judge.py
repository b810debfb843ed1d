"""The judge on motions of known quality, and its protection against systems that cheat."""

import numpy as np
import pytest

from benchmarks.peers.judge import Judge
from benchmarks.peers.task import Task

#: A square of two triangles around its centre node… four triangles; node 4 is the centre, node 0 moves.
POINTS = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1], [0.5, 0.5]])
CELLS = {"triangle": np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])}


def task(*displacements: tuple[float, float]) -> Task:
    moves = np.array(displacements, dtype=float).reshape(-1, 1, 2)
    return Task(POINTS, CELLS, np.array([0]), np.array([1, 2, 3]), moves)


def positions(centre: tuple[float, float], corner: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    moved = POINTS.copy()
    moved[4], moved[0] = centre, corner
    return moved


def test_a_mesh_at_rest_has_size_one_and_the_skew_of_its_triangles() -> None:
    verdict = Judge(task((0, 0))).verdict([POINTS])
    # right isosceles triangles: mean ratio 2√3 area·2 / Σ edge² = √3/2
    assert verdict.min_size == pytest.approx(1)
    assert verdict.min_size_skew == pytest.approx(3**0.5 / 2)
    assert verdict.mean_size_skew == pytest.approx(3**0.5 / 2)
    assert (verdict.inverted, verdict.most_inverted, verdict.boundary_error) == (0, 0, 0)


def test_the_shape_is_compared_with_the_cells_at_rest() -> None:
    judge = Judge(task((0, 0)))
    assert judge.verdict([POINTS]).min_shape == pytest.approx(1)
    # the flattest triangle has two fifths of its height at rest: T = diag(1, 0.4)
    assert judge.verdict([positions((0.5, 0.2))]).min_shape == pytest.approx(2 * 0.4 / (1 + 0.4**2))
    assert judge.verdict([positions((0.5, -0.25))]).min_shape == 0


def test_faces_are_judged_at_the_end_and_at_rest() -> None:
    verdict = Judge(task((0, 0))).verdict([positions((0.5, 0.2))])
    assert verdict.rest_non_orthogonality == pytest.approx(0.0, abs=1e-5)
    # centroids (0.5, 0.2 / 3) and (2.5 / 3, 1.2 / 3); the edge leads from (1, 0) to (0.5, 0.2)
    d, edge = np.array([1.0, 1.0]) / 3, np.array([-0.5, 0.2])
    sine = abs(d @ edge) / np.linalg.norm(d) / np.linalg.norm(edge)
    assert verdict.non_orthogonality == pytest.approx(np.degrees(np.arcsin(sine)))
    assert (verdict.faces_above_65, verdict.faces_above_75) == (0, 0)


def test_inverted_cells_are_counted_in_every_step() -> None:
    steps = [positions((0.5, -0.25)), positions((0.5, 0.5))]
    verdict = Judge(task((0, 0), (0, 0))).verdict(steps)
    assert (verdict.inverted, verdict.most_inverted) == (0, 1)
    assert Judge(task((0, 0))).verdict(steps[:1]).min_size_skew < 0


def test_a_boundary_that_is_not_at_its_prescribed_position_shows() -> None:
    asked = task((-0.1, 0.0))
    assert Judge(asked).verdict([positions((0.5, 0.5), (-0.1, 0.0))]).boundary_error == 0
    assert Judge(asked).verdict([POINTS]).boundary_error == pytest.approx(0.1)
    drifted = positions((0.5, 0.5), (-0.1, 0.0))
    drifted[2] += (0.0, 0.03)
    assert Judge(asked).verdict([drifted]).boundary_error == pytest.approx(0.03)


def test_missing_steps_and_wrong_shapes_are_refused() -> None:
    judge = Judge(task((0, 0), (0, 0)))
    with pytest.raises(ValueError, match="after 2 steps, got 1"):
        judge.verdict([POINTS])
    with pytest.raises(ValueError, match="expected positions"):
        judge.verdict([POINTS[:3]])
