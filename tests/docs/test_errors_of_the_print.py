"""Misprints of the thesis listed in docs/thesis.md, computed: the printed form fails where the correct one holds.

It covers only rows that no other test shows; the page names a test or a study for each of its rows.
"""

import numpy as np
import pytest
from mesh_motion_numerics.correction.enrichment.functions import values as enrichment_values
from mesh_motion_numerics.interpolation import evaluation
from mesh_motion_numerics.interpolation.interpolant import factorize
from mesh_motion_numerics.interpolation.kernels import BASES, values
from mesh_motion_numerics.mesh.cells import CELL_TYPES, CellTable
from mesh_motion_numerics.quality.metrics import cell_quality, reference_sizes
from mesh_motion_numerics.reduction import ReductionProblem

from docs.studies.thesis._decompositions import polar, rotation_angle
from docs.studies.thesis._linear_polynomial import WithPolynomial
from docs.studies.thesis._point_reduction.one_point import _Corrections

CUBE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]], dtype=float)


def test_ctps_c1_vanishes_at_its_radius_with_80_thirds_only() -> None:
    def at_radius(second: float) -> float:
        return 1 + second - 40 + 15 - 8 / 3

    assert at_radius(20 / 3) == pytest.approx(-20.0)
    assert at_radius(80 / 3) == pytest.approx(0.0, abs=1e-14)
    assert abs(values(BASES["ctps-c1"], [1.0])[0]) < 1e-14


def test_a_displacement_of_2_6_has_no_row_of_zeros() -> None:
    """[φ_in,b P_in] times the coefficients has one row per node; the print has d + 1 rows more than d_in."""
    points = np.random.default_rng(1).uniform(size=(12, 2))
    displacement = np.stack([points[:, 0] ** 2, points[:, 1]], axis=1)
    found = WithPolynomial(factorize(points, support_radius=0.8)).solve(displacement)
    nodes = np.array([[0.3, 0.4], [0.6, 0.2]])
    phi = values(found.basis, np.linalg.norm(nodes[:, None] - points[None], axis=2) / 0.8)
    printed = np.hstack([phi, found.polynomial.basis.matrix(nodes)]) @ np.vstack(
        [found.weights, found.polynomial.coefficients]
    )
    assert printed.shape == (2, 2)
    np.testing.assert_allclose(printed, evaluation.displacement(found, nodes), atol=1e-13)


def test_a_one_point_correction_takes_away_the_error_at_boundary_nodes() -> None:
    """f_max of (2.8) is an error and f of (2.10) a displacement: they have opposite signs."""
    points = np.array([[0.0, 0, 0], [0.3, 0, 0], [0.9, 0, 0]])
    error = np.array([[0.1], [0.5], [0.2]])
    corrections = _Corrections(ReductionProblem(points, error))
    corrections._correct(1)
    assert corrections.error[1, 0] == 0.0
    phi = values(BASES["wendland-c2"], np.array([0.3, 0.6]))
    np.testing.assert_allclose(corrections.error[[0, 2], 0], [0.1, 0.2] - 0.5 * phi, rtol=1e-14)


def test_an_undeformed_cell_has_size_1() -> None:
    """(2.13) as printed, the sum of the corners' ratios, gives 4 for a quad and hence a size of 1/4."""
    points, cells = (
        np.array([[0.0, 0], [2, 0], [2, 1], [0, 1]]),
        CellTable.from_arrays({"quad": np.array([[0, 1, 2, 3]])}),
    )
    corners = [np.linalg.det((points[list(c[1:])] - points[c[0]]).T) for c in CELL_TYPES["quad"].corners]
    assert sum(a / a0 for a, a0 in zip(corners, corners, strict=True)) == 4.0
    assert cell_quality(points, cells, reference_sizes(points, cells)).size[0] == 1.0


def test_the_corners_of_3_29_are_those_of_table_2_4_at_the_first_node_only() -> None:
    printed = [(k, (k + 1) % 8, (k + 3) % 8, (k + 4) % 8) for k in range(8)]
    table = CELL_TYPES["hexahedron"].corners
    assert [k for k in range(8) if printed[k] == table[k]] == [0]
    volumes = [np.linalg.det((CUBE[list(others)] - CUBE[k]).T) for k, *others in printed]
    assert min(volumes) < 0.0  # of a cube
    np.testing.assert_allclose([np.linalg.det((CUBE[list(others)] - CUBE[k]).T) for k, *others in table], 1.0)
    assert CELL_TYPES["quad"].corners == tuple((k, (k + 1) % 4, (k + 3) % 4) for k in range(4))  # (3.23)


def test_the_corners_of_a_tetrahedron_take_turns_in_sign() -> None:
    """The columns x_(k+1), x_(k+2), x_(k+3) of (3.25) need the factor (−1)^k that §2.3 prints before them."""
    x = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    printed = np.array([np.linalg.det((x[[(k + i) % 4 for i in (1, 2, 3)]] - x[k]).T) for k in range(4)])
    np.testing.assert_allclose(printed, [1.0, -1.0, 1.0, -1.0])
    np.testing.assert_allclose(printed * (-1.0) ** np.arange(4), 1.0)


def test_equal_off_diagonals_stretch_and_opposite_ones_turn() -> None:
    """§3.3.1 takes equal off-diagonal gradients for a rotation."""
    equal, opposite = (np.eye(2) + 0.1 * np.array([[0.0, s], [1.0, 0.0]]) for s in (1.0, -1.0))
    stretched, turned = polar(equal[None]), polar(opposite[None])
    assert rotation_angle(stretched.rotation)[0] == pytest.approx(0.0, abs=1e-15)
    np.testing.assert_allclose(np.linalg.eigvalsh(stretched.stretch[0]), [0.9, 1.1])
    assert rotation_angle(turned.rotation)[0] == pytest.approx(np.arctan(0.1))
    np.testing.assert_allclose(turned.stretch[0], np.sqrt(1.01) * np.eye(2), atol=1e-15)


def test_h2_and_h3_end_at_their_radius() -> None:
    """(4.6) as printed continues beyond R_l, with the wrong sign; (4.7) as printed is even, so its slope is zero."""
    x, radius = np.array([[-0.3], [0.3], [1.2]]), 1.0
    r = np.abs(x[:, 0])
    assert (-20 * x[:, 0] * (radius - r) ** 3 / radius**5)[2] > 0.0
    assert enrichment_values("H2", x, np.zeros(1), radius)[2, 0] == 0.0
    printed = -20 * x[:, 0] ** 2 * (radius - r**3) / radius**5 * np.maximum(0, 1 - r) ** 4 * (4 * r + 1)
    assert printed[0] == printed[1] != 0.0
    ours = enrichment_values("H3", x, np.zeros(1), radius)[:, 0]
    assert ours[0] == -ours[1] > 0.0


def test_the_jacobian_that_multiplies_a_cell_is_not_that_of_5_5() -> None:
    """B = I + J of (5.7) multiplies edges as columns: J_ij = ∂S_i/∂x_j, of which (5.5) prints the transpose."""
    turn = np.array([[0.0, -0.2], [0.5, 0.0]])  # ∂S_i/∂x_j
    edge = np.array([1.0, 0.0])
    moved = edge + turn @ edge
    np.testing.assert_array_equal((np.eye(2) + turn) @ edge, moved)
    assert not np.array_equal((np.eye(2) + turn.T) @ edge, moved)
