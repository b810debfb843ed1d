"""A system with fewer unknowns: the same result as with dense matrices."""

import numpy as np
from box_meshes import box_mesh
from mesh_motion_numerics.correction.free_region import free_region
from mesh_motion_numerics.correction.linked_unknowns import LinkedUnknowns


def test_the_reduced_system_is_that_of_the_dense_matrices() -> None:
    mesh = box_mesh("tetra", 5)
    adjacency = free_region(mesh.points, mesh.cells, mesh.sizes, ~mesh.held).adjacency
    rng = np.random.default_rng(0)
    f, d = len(adjacency.row_starts) - 1, 3
    representatives = np.arange(f)
    representatives[[7, 20, 30]] = [3, 3, 11]
    matrices = np.broadcast_to(np.eye(d), (f, d, d)).copy()
    tangential = np.eye(d) - np.full((d, d), 1 / 3)
    matrices[3] = matrices[15] = tangential
    turn = np.linalg.qr(rng.normal(size=(d, d)))[0]
    matrices[7], matrices[20], matrices[30] = turn @ tangential, tangential, turn
    blocks, right = rng.normal(size=(len(adjacency.columns), d, d)), rng.normal(size=(f, d))
    blocks[adjacency.row_starts[:-1]] += 20.0 * np.eye(d)

    links = LinkedUnknowns.build(adjacency, representatives)
    hessian, sums = links.reduce(matrices, blocks), links.gather(matrices, right)

    m = np.zeros((f * d, len(links.roots) * d))
    for i in range(f):
        t = links.targets[i]
        m[i * d : i * d + d, t * d : t * d + d] = matrices[i]
    expected = m.T @ dense(adjacency.row_starts, adjacency.columns, blocks) @ m
    found = dense(links.adjacency.row_starts, links.adjacency.columns, hessian)
    for root in np.flatnonzero(np.isin(links.roots, [3, 15])):  # stiffness of the directions that it must not take
        own = slice(root * d, root * d + d)
        expected[own, own] += np.trace(expected[own, own]) * (np.eye(d) - tangential)
    np.testing.assert_allclose(found, expected, atol=1e-12)
    np.testing.assert_allclose(sums.ravel(), m.T @ right.ravel(), atol=1e-13)
    assert (links.adjacency.columns[links.adjacency.row_starts[:-1]] == np.arange(len(links.roots))).all()
    step = rng.normal(size=(len(links.roots), d))
    np.testing.assert_allclose(links.expand(matrices, step).ravel(), m @ step.ravel(), atol=1e-14)


def dense(starts: np.ndarray, columns: np.ndarray, blocks: np.ndarray) -> np.ndarray:
    n, d = len(starts) - 1, blocks.shape[1]
    out = np.zeros((n, d, n, d))
    for i in range(n):
        for e in range(starts[i], starts[i + 1]):
            out[i, :, columns[e]] += blocks[e]
    return out.reshape(n * d, n * d)
