"""The positive semi-definite blocks compared with projected numerical Hessians."""

import numpy as np
import pytest
from mesh_motion_numerics.correction.distortion import (
    PNorm,
    corner_blocks,
    corner_simplices,
    determinants,
    distortion_gradient,
)
from test_distortion import one_cell


def numerical_block(points: np.ndarray, simplices, norm: PNorm, *, project: bool) -> np.ndarray:
    """Hessian of ℓ plus p g gᵀ at the edges, from differences of the gradient; negative curvature removed in J."""
    d = points.shape[1]

    def gradient(x: np.ndarray) -> np.ndarray:
        return distortion_gradient(x, simplices, np.ones(1), norm)[0].ravel()

    rows = []
    for i in np.ndindex(*points.shape):
        step = np.zeros_like(points)
        step[i] = 1e-6
        rows.append((gradient(points + step) - gradient(points - step)) / 2e-6)
    g = gradient(points)[d:]
    hessian = np.array(rows)[d:, d:] + norm.p * np.outer(g, g)
    hessian = 0.5 * (hessian + hessian.T)
    if not project:
        return hessian
    to_edges = np.kron(simplices.ideal[0], np.eye(d))
    inverse = np.linalg.inv(to_edges)
    values, vectors = np.linalg.eigh(inverse @ hessian @ inverse.T)
    return to_edges @ (vectors * np.maximum(values, 0.0)) @ vectors.T @ to_edges.T


def block_of(points: np.ndarray, simplices, norm: PNorm) -> np.ndarray:
    d = points.shape[1]
    out = np.zeros((1, d * d, d * d), dtype=np.float32)
    corner_blocks(points, simplices, np.ones(1), norm, out, floor=0.0)
    return out.reshape(d, d, d, d).swapaxes(1, 2).reshape(d * d, d * d)


@pytest.mark.parametrize("name", ["line", "triangle", "tetra"])
@pytest.mark.parametrize("norm", [PNorm(1, 2), PNorm(24, 4), PNorm(2, 1, 0.3)], ids=str)
def test_a_block_is_the_hessian_without_its_negative_part(name: str, norm: PNorm) -> None:
    reference, cells, sizes = one_cell(name)
    simplices, rng, checked = corner_simplices(reference, cells, sizes), np.random.default_rng(1), 0
    for _ in range(20):
        points = reference + 0.3 * rng.normal(size=reference.shape)
        if norm.epsilon == 0.0 and determinants(points, simplices)[0] < 0.1:
            continue
        expected = numerical_block(points, simplices, norm, project=True)
        # single precision, and differences of the gradient
        np.testing.assert_allclose(block_of(points, simplices, norm), expected, atol=1e-6 * np.abs(expected).max())
        checked += 1
    assert checked > 3


@pytest.mark.parametrize("shape", ["flat", "needle", "point", "mirrored"])
def test_blocks_of_degenerate_cells_are_finite_while_untangling(shape: str) -> None:
    for name in ("triangle", "tetra"):
        reference, cells, sizes = one_cell(name)
        d = reference.shape[1]
        scale = {
            "flat": [1.0] * (d - 1) + [0.0],
            "needle": [1.0] + [1e-9] * (d - 1),
            "mirrored": [-1.0] + [1.0] * (d - 1),
        }
        points = reference * scale.get(shape, [1e-12] * d)
        block = block_of(points, corner_simplices(reference, cells, sizes), PNorm(2, 1, 0.1))
        assert np.isfinite(block).all()
        assert np.linalg.eigvalsh(block.astype(float)).min() >= -1e-5 * np.abs(block).max()


def test_light_corners_keep_their_block() -> None:
    reference, cells, sizes = one_cell("triangle")
    simplices = corner_simplices(reference, cells, sizes)
    blocks = np.full((1, 4, 4), 7.0, dtype=np.float32)
    corner_blocks(reference, simplices, np.array([0.5]), PNorm(1, 2), blocks, least_weight=0.6)
    assert (blocks == 7.0).all()
