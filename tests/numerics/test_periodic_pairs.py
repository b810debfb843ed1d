"""Pairs of periodic patches: translations, sectors, orbits, and refusals."""

import numpy as np
import pytest
from box_meshes import box_mesh
from mesh_motion_numerics.mesh.boundary_facets import boundary_facets
from mesh_motion_numerics.mesh.periodic_nodes import PeriodicNodes
from mesh_motion_numerics.mesh.periodic_pairs import PeriodicPair, periodic_pairs
from mesh_motion_numerics.mesh.rigid_transforms import Transform, generated_group
from mesh_motion_numerics.mesh.roles import BoundaryRoles, Patch
from mesh_motion_protocol.errors import InvalidInput
from periodic_meshes import periodic_box, sector, turn


def pairs_of(mesh) -> tuple[PeriodicPair, ...]:
    points, cells, patches = mesh
    sides = {name: patch.nodes for name, patch in patches.items() if patch.role == "periodic"}
    return periodic_pairs(points, boundary_facets(cells), sides)


@pytest.mark.parametrize("kind", ["quad", "tetra"])
def test_opposite_sides_of_a_box_are_a_translation_apart(kind: str) -> None:
    (pair,) = pairs_of(periodic_box(kind, 5))
    assert (pair.first, pair.second, pair.error) == ("y0", "y1", 0.0)
    np.testing.assert_array_equal(pair.transform.shift, np.eye(3)[1][: len(pair.transform.shift)])
    assert "y0 and y1: " in pair.describe()
    assert "translation by (0, 1" in pair.describe()


def test_short_periods_of_a_long_mesh_are_not_one() -> None:
    points, cells, patches = periodic_box("hexahedron", 5, axes="yz")
    points = points * [1.0, 5e-4, 8e-4]
    assert len(PeriodicNodes.of_pairs(points, pairs_of((points, cells, patches))).generators) == 2


def test_a_cube_with_three_pairs_is_not_taken_for_a_sector() -> None:
    """Neighbouring sides of a cube map onto each other by a quarter turn about their edge."""
    pairs = pairs_of(periodic_box("hexahedron", 5, axes="xyz"))
    assert [(pair.first, pair.second) for pair in pairs] == [("x0", "x1"), ("y0", "y1"), ("z0", "z1")]
    assert not any(pair.transform.turns for pair in pairs)


@pytest.mark.parametrize("kind", ["quad", "hexahedron", "tetra"])
@pytest.mark.parametrize("sectors", [2, 3, 6, 36])
def test_a_sector_is_a_rotation_by_exactly_its_share(kind: str, sectors: int) -> None:
    mesh = sector(kind, 5, sectors=sectors)
    (pair,) = pairs_of(mesh)
    d = mesh[0].shape[1]
    found = pair.transform.rotation
    expected = turn(sectors, d)
    assert min(np.abs(found - expected).max(), np.abs(found - expected.T).max()) < 1e-14
    np.testing.assert_allclose(pair.transform.shift, 0.0, atol=1e-14)
    np.testing.assert_allclose(pair.transform(mesh[0][pair.nodes[:, 0]]), mesh[0][pair.nodes[:, 1]], atol=1e-14)
    assert pair.describe().endswith(f"nodes each, rotation by 360°/{sectors}")


@pytest.mark.parametrize("kind", ["quad", "tetra"])
@pytest.mark.parametrize("degrees", [50.0, 51.4, 102.857, 170.0])
def test_a_sector_has_any_angle(kind: str, degrees: float) -> None:
    """51.4° is nearly a seventh of a turn, but no node is at that place."""
    (pair,) = pairs_of(sector(kind, 10, sectors=360.0 / degrees))
    assert pair.transform.sectors == 0
    assert np.degrees(abs(pair.transform.angle)) == pytest.approx(degrees, rel=1e-12)
    assert pair.describe().endswith(f"nodes each, rotation by {degrees:g}°")
    assert pair.error < 1e-13


@pytest.mark.parametrize("kind", ["quad", "tetra"])
@pytest.mark.parametrize("degrees", [190.0, 240.0, 270.0, 330.0])
def test_a_sector_of_more_than_half_a_turn_is_no_smaller_one(kind: str, degrees: float) -> None:
    """A rotation by 270° has the matrix of one by −90°, whose images would lie in the mesh."""
    with pytest.raises(InvalidInput, match=f"'y0' and 'y1' are {degrees:g}° apart, measured through the mesh"):
        pairs_of(sector(kind, 10, sectors=360.0 / degrees))


@pytest.mark.parametrize("make", [periodic_box, sector])
@pytest.mark.parametrize("kind", ["quad", "hexahedron"])
@pytest.mark.parametrize("names", [("a1", "a2", "b1", "b2"), ("a1", "a2", "b2", "b1"), ("a", "y", "b", "c")])
def test_halves_of_divided_sides_are_paired_by_their_common_period(make, kind: str, names: tuple[str, ...]) -> None:
    """Each half fits both halves opposite, and the other half of its own side after half a turn."""
    points, cells, patches = make(kind, 10)
    out = np.linalg.norm(points[:, :2], axis=1) - 1.0 if make is sector else points[:, 0]
    halves = [patches[side].nodes[keep(out[patches[side].nodes])] for side in ("y0", "y1") for keep in (low, high)]
    patches = {"body": patches["body"]} | {
        name: Patch("periodic", nodes) for name, nodes in zip(names, halves, strict=True)
    }
    (whole,) = pairs_of(make(kind, 10))
    found = pairs_of((points, cells, patches))
    assert {frozenset((pair.first, pair.second)) for pair in found} == {
        frozenset((names[0], names[2])),
        frozenset((names[1], names[3])),
    }
    assert len(PeriodicNodes.of_pairs(points, found).generators) == 1
    for pair in found:
        forth = pair.transform if np.isin(pair.nodes[0, 0], whole.nodes[:, 0]) else pair.transform.inverse()
        np.testing.assert_allclose(forth.rotation, whole.transform.rotation, atol=1e-12)
        np.testing.assert_allclose(forth.shift, whole.transform.shift, atol=1e-12)


def low(values: np.ndarray) -> np.ndarray:
    return values < 0.5 + 1e-9


def high(values: np.ndarray) -> np.ndarray:
    return values > 0.5 - 1e-9


def test_a_sector_anywhere_in_space_is_found() -> None:
    points, cells, patches = sector("hexahedron", 5)
    rotation = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    rotation *= np.linalg.det(rotation)
    (pair,) = pairs_of((points @ rotation.T + [3.0, -2.0, 5.0], cells, patches))
    assert pair.error < 1e-13


def test_nodes_off_by_file_precision_are_still_pairs() -> None:
    points, cells, patches = sector("quad", 10)
    (pair,) = pairs_of((points.astype(np.float32).astype(np.float64), cells, patches))
    assert 0.0 < pair.error < 1e-6


@pytest.mark.parametrize("make", [periodic_box, sector])
def test_a_node_without_an_image_is_named_with_its_distance(make) -> None:
    points, cells, patches = make("quad", 10)
    side = patches["y1"].nodes
    moved = points.copy()
    moved[side[4]] += 0.01 * (points[side[5]] - points[side[4]])
    with pytest.raises(
        InvalidInput, match=r"'y0' \(11 nodes\) and 'y1' \(11 nodes\) do not map onto each other: node \d"
    ):
        pairs_of((moved, cells, patches))
    with pytest.raises(InvalidInput, match=r"\(11 nodes\) and 'y1' \(10 nodes\)") as refusal:
        pairs_of((points, cells, {**patches, "y1": type(patches["y1"])("periodic", np.delete(side, 3))}))
    assert refusal.value.details["distance"] > 1e-3


def test_a_side_is_not_its_own_image() -> None:
    points, cells, patches = periodic_box("quad", 10)
    with pytest.raises(InvalidInput, match="'a' and 'b' have the same nodes"):
        pairs_of((points, cells, {"a": patches["y0"], "b": patches["y0"]}))


def test_corners_of_a_doubly_periodic_box_are_one_orbit() -> None:
    mesh = periodic_box("hexahedron", 5, axes="xyz")
    nodes = PeriodicNodes.of_pairs(mesh[0], pairs_of(mesh))
    sizes = np.unique(nodes.roots, return_counts=True)[1]
    assert (np.unique(sizes) == [2, 4, 8]).all()
    assert (sizes == 8).sum() == 1
    assert (sizes == 4).sum() == 3 * 4
    corners = np.flatnonzero(((mesh[0] == 0.0) | (mesh[0] == 1.0)).all(axis=1))
    assert len(set(nodes.root_of(corners).tolist())) == 1
    assert nodes.root_of(np.array([len(mesh[0]) // 2]))[0] == len(mesh[0]) // 2


def test_a_node_on_the_axis_moves_along_it_only() -> None:
    points = np.array([[0.0, 0.0, 0.3], [1.0, 0.0, 0.3], [0.0, 1.0, 0.3]])
    transform = Transform.about(np.zeros(3), np.pi / 2, np.array([0.0, 0.0, 1.0]))
    pair = PeriodicPair("a", "b", transform, np.array([[0, 0], [1, 2]]), 0.0)
    nodes = PeriodicNodes.of_pairs(points, [pair])
    tied = nodes.tied(points + np.array([0.1, 0.2, 0.3]), np.empty(0, dtype=np.int64))
    np.testing.assert_allclose(tied - points, [[0, 0, 0.3], [0.1, 0.2, 0.3], [-0.2, 0.1, 0.3]], atol=1e-15)
    np.testing.assert_array_equal(nodes.on_axis, [True, False, False])


def test_images_share_coordinates_bitwise() -> None:
    points, cells, patches = periodic_box("quad", 10)
    nodes = PeriodicNodes.of_pairs(points, pairs_of((points, cells, patches)))
    moved = points + np.random.default_rng(0).normal(size=points.shape)
    tied = nodes.tied(moved, np.empty(0, dtype=np.int64))
    assert (tied[nodes.members, 0] == tied[nodes.roots, 0]).all()
    assert np.array_equal(nodes.tied(points, patches["body"].nodes), points)


def test_a_pair_of_two_roles_is_refused() -> None:
    points, cells, patches = periodic_box("quad", 10)
    patches["x0"] = type(patches["x0"])("fixed", patches["x0"].nodes[1:])
    with pytest.raises(InvalidInput, match=r"node 10 is fixed but node 0, its periodic image, is periodic"):
        PeriodicNodes.build(points, boundary_facets(cells), patches, BoundaryRoles.from_patches(patches))


def test_a_group_closes_or_is_bounded() -> None:
    quarter = Transform.about(np.array([0.5, 0.5]), np.pi / 2)
    assert len(generated_group([quarter], 2, 1.0, lambda _: True)) == 4
    lattice = [Transform.translation(np.array(s)) for s in ([1.0, 0.0], [0.3, 1.0])]
    near = generated_group(lattice, 2, 1.0, lambda t: float(np.abs(t.shift).max()) < 2.5)
    assert len(near) == len({tuple(np.round(t.shift, 6)) for t in near}) > 20
    with pytest.raises(InvalidInput, match="smaller support_radius"):
        generated_group([Transform.translation(np.array([1e-6]))], 1, 1e-3, lambda _: True)


def test_transforms_compose_and_invert() -> None:
    a = Transform.about(np.array([1.0, 2.0, 0.0]), 0.7, np.array([0.0, 0.6, 0.8]))
    b = Transform.translation(np.array([0.1, 0.2, 0.3]))
    x = np.random.default_rng(0).normal(size=(5, 3))
    np.testing.assert_allclose(b.after(a)(x), b(a(x)), atol=1e-15)
    np.testing.assert_allclose(a.inverse()(a(x)), x, atol=1e-15)
    np.testing.assert_array_equal(
        b.inverse()(b(box_mesh("tetra", 5).points)).round(15), box_mesh("tetra", 5).points.round(15)
    )
