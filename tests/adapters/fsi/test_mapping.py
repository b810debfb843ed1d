"""The mapping between interfaces that do not match: what is exact, and what is kept."""

import numpy as np
import pytest
from mesh_motion_fsi import Mapping, SetupError


def flap(along, across):
    y, x = np.linspace(0.0, 1.0, along), np.linspace(-0.05, 0.05, across)[1:-1]
    sides = [np.stack([np.full(along, side), y], axis=1) for side in (-0.05, 0.05)]
    return np.concatenate([*sides, np.stack([x, np.ones_like(x)], axis=1)])


def sphere(n):
    points = np.random.default_rng(n).normal(size=(n, 3))
    return points / np.linalg.norm(points, axis=1)[:, None]


PLATE = np.array([[x, y, 0.0] for x in range(4) for y in range(3)], dtype=float)
INTERFACES = {
    "flap": (flap(21, 3), flap(34, 5)),
    "sphere": (sphere(60), sphere(90)),
    "plate": (PLATE, PLATE[:-1] + np.array([0.3, 0.2, 0.0])),  # a plane in space: the polynomial is not unique
    "line": (np.linspace([0.0, 0.0], [2.0, 1.0], 5), np.linspace([0.0, 0.0], [2.0, 1.0], 8)),
}


@pytest.mark.parametrize("name", INTERFACES)
def test_linear_fields_and_rigid_motions_are_exact(name):
    sources, targets = INTERFACES[name]
    d = sources.shape[1]
    gradient = np.random.default_rng(1).normal(size=(d, d))
    mapped = Mapping(sources, targets).displacements(sources @ gradient + 1.5)
    np.testing.assert_allclose(mapped, targets @ gradient + 1.5, rtol=0, atol=1e-11)


@pytest.mark.parametrize("name", INTERFACES)
def test_force_moment_and_work_are_kept(name):
    sources, targets = INTERFACES[name]
    mapping, rng = Mapping(sources, targets), np.random.default_rng(2)
    forces, displacements = rng.normal(size=targets.shape), rng.normal(size=sources.shape)
    loads = mapping.loads(forces)
    np.testing.assert_allclose(loads.sum(axis=0), forces.sum(axis=0), rtol=0, atol=1e-11)
    np.testing.assert_allclose(sources.T @ loads, targets.T @ forces, rtol=0, atol=1e-11)  # with it every moment
    np.testing.assert_allclose(np.sum(loads * displacements), np.sum(forces * mapping.displacements(displacements)))


def test_sources_keep_their_values():
    sources, _ = INTERFACES["sphere"]
    values = np.random.default_rng(3).normal(size=(len(sources), 3))
    np.testing.assert_allclose(Mapping(sources, sources).displacements(values), values, rtol=0, atol=1e-10)


def test_bending_converges_with_the_nodes():
    """The order is between two and three: twice the nodes leave less than a third of the error."""
    _, targets = INTERFACES["flap"]
    errors = []
    for along in (6, 11, 21):
        sources = flap(along, 3)
        mapped = Mapping(sources, targets).displacements(np.sin(3.0 * sources[:, 1:]))
        errors.append(np.abs(mapped - np.sin(3.0 * targets[:, 1:])).max())
    assert errors[2] < 2e-3
    assert errors[0] / errors[2] > 9.0


def test_units_do_not_matter():
    sources, targets = INTERFACES["flap"]
    np.testing.assert_allclose(
        Mapping(1e-6 * sources, 1e-6 * targets).matrix, Mapping(sources, targets).matrix, rtol=0, atol=1e-9
    )


def test_a_single_node_is_a_rigid_translation():
    mapping = Mapping([[1.0, 2.0]], [[0.0, 0.0], [3.0, 3.0]])
    np.testing.assert_allclose(mapping.displacements([[0.5, -1.0]]), [[0.5, -1.0]] * 2)


@pytest.mark.parametrize(
    ("sources", "targets", "words"),
    [
        ([[0.0, 0.0], [1.0, 0.0], [0.0, 0.0]], [[0.0, 0.0]], "sources 0 and 2 are at one place"),
        ([[0.0, 0.0]], [[0.0, 0.0, 0.0]], r"must have shapes \(k, d\) and \(m, d\)"),
        (np.zeros((0, 2)), [[0.0, 0.0]], "must have shapes"),
    ],
)
def test_places_that_cannot_be_mapped(sources, targets, words):
    with pytest.raises(SetupError, match=words):
        Mapping(sources, targets)
