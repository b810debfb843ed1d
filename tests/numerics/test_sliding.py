import numpy as np
import pytest
from box_meshes import box_mesh
from frame_meshes import ring_grid, tensor_grid
from mesh_motion_numerics.mesh.boundary_facets import boundary_facets, boundary_nodes
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.rigid_transforms import Transform
from mesh_motion_numerics.mesh.sliding import SlidingSurfaces
from mesh_motion_numerics.mesh.surface_constraints import OnFacets
from mesh_motion_numerics.mesh.wall_lines import WallLine
from mesh_motion_protocol.errors import InvalidInput
from scipy.spatial import ConvexHull


def unit_grid(*counts):
    points, cells = tensor_grid(*[np.linspace(0, 1, n + 1) for n in counts])
    return points, CellTable.from_arrays({"quad" if len(counts) == 2 else "hexahedron": cells})


def ring(around, across, inner=0.5):
    """An annulus of quads about the origin with outer radius 1, its outer and inner nodes."""
    points, quads = ring_grid(np.linspace(inner, 1, across + 1), around)
    index = np.arange(len(points)).reshape(across + 1, around)
    return points, CellTable.from_arrays({"quad": quads}), index[-1], index[0]


def pipe(around, across, along):
    """A thick pipe of hexahedra about the z axis, outer radius 1, length 1; nodes [layer, ring, angle]."""
    flat, cells, _, _ = ring(around, across)
    z = np.linspace(0, 1, along + 1)
    points = np.concatenate([np.column_stack([flat, np.full(len(flat), height)]) for height in z])
    quads = cells.blocks[0].nodes
    hexahedra = np.concatenate([np.hstack([quads + k * len(flat), quads + (k + 1) * len(flat)]) for k in range(along)])
    index = np.arange(len(points)).reshape(along + 1, across + 1, around)
    return points, CellTable.from_arrays({"hexahedron": hexahedra}), index


def polygon_distance(points, vertices):
    """Distance of points to a closed polygon, by brute force."""
    a, b = vertices, np.roll(vertices, -1, axis=0)
    t = np.einsum("nfi,fi->nf", points[:, None] - a, b - a) / np.sum((b - a) ** 2, axis=1)
    near = a + np.clip(t, 0, 1)[..., None] * (b - a)
    return np.min(np.linalg.norm(points[:, None] - near, axis=2), axis=1)


class TestPlanar:
    def test_side_of_a_square_keeps_its_coordinate_bitwise(self):
        points, cells = unit_grid(6, 6)
        side = np.flatnonzero(points[:, 0] == 1)
        surfaces = SlidingSurfaces.build(points, boundary_facets(cells), {"side": side}, side[1:-1])
        pushed = points[side[1:-1]] + [0.2, 0.03]
        slid = surfaces.project(pushed)
        assert (slid[:, 0] == 1).all()
        assert (slid[:, 1] == pushed[:, 1]).all()

    def test_oblique_plane_is_kept_to_rounding(self):
        points, cells = unit_grid(4, 4, 4)
        rotation = np.linalg.qr(np.random.default_rng(3).standard_normal((3, 3)))[0]
        rotation *= np.sign(np.linalg.det(rotation))
        side = np.flatnonzero(points[:, 2] == 1)
        turned = points @ rotation.T + 10.0
        surfaces = SlidingSurfaces.build(turned, boundary_facets(cells), {"top": side}, side)
        push = 0.1 * np.random.default_rng(1).standard_normal((len(side), 3))
        slid = surfaces.project(turned[side] + push)
        normal = rotation[:, 2]
        assert np.max(np.abs((slid - turned[side]) @ normal)) <= 1e-14 * 10
        tangential = push - np.outer(push @ normal, normal)
        assert np.allclose(slid - turned[side], tangential, rtol=0, atol=1e-14 * 10)

    def test_two_planes_leave_their_line_and_three_a_point(self):
        points, cells = unit_grid(4, 4, 4)
        sides = {f"{axis}": np.flatnonzero(points[:, axis] == 0) for axis in range(3)}
        nodes = np.unique(np.concatenate(list(sides.values())))
        surfaces = SlidingSurfaces.build(points, boundary_facets(cells), sides, nodes)
        slid = surfaces.project(points[nodes] + 0.01)
        held = points[nodes] == 0
        assert (slid[held] == 0).all()
        # on the far rim of a side only its own plane holds nodes: the other sides are not sliding patches
        assert np.allclose(slid[~held], points[nodes][~held] + 0.01, rtol=0, atol=1e-15)

    def test_a_box_in_one_patch_keeps_its_edges(self):
        points, cells = unit_grid(3, 4, 5)
        nodes = boundary_nodes(cells)
        surfaces = SlidingSurfaces.build(points, boundary_facets(cells), {"walls": nodes}, nodes)
        slid = surfaces.project(points[nodes] + np.random.default_rng(0).uniform(-0.1, 0.1, (len(nodes), 3)))
        on_wall = (points[nodes] == 0) | (points[nodes] == 1)
        assert (slid[on_wall] == points[nodes][on_wall]).all()
        assert (slid[~on_wall] != points[nodes][~on_wall]).all()

    def test_oblique_planes_meet_in_their_line(self):
        points, cells = unit_grid(4, 4)
        sheared = points @ np.array([[1.0, 0.3], [0.4, 1.0]])
        left, bottom = np.flatnonzero(points[:, 0] == 0), np.flatnonzero(points[:, 1] == 0)
        nodes = np.union1d(left, bottom)
        surfaces = SlidingSurfaces.build(sheared, boundary_facets(cells), {"l": left, "b": bottom}, nodes)
        slid = surfaces.project(sheared[nodes] + 0.05)
        corner = np.flatnonzero(nodes == np.intersect1d(left, bottom)[0])
        assert np.allclose(slid[corner], 0, atol=1e-15)

    def test_a_node_off_its_plane_by_file_precision_keeps_its_own_offset(self):
        points, cells = unit_grid(4, 4)
        rough = points.astype(np.float32).astype(np.float64)
        rough += 1e-8 * np.random.default_rng(0).standard_normal(points.shape)
        side = np.flatnonzero(points[:, 0] == 0)[1:-1]
        surfaces = SlidingSurfaces.build(rough, boundary_facets(cells), {"s": np.flatnonzero(points[:, 0] == 0)}, side)
        assert np.allclose(surfaces.project(rough[side]), rough[side], rtol=0, atol=1e-16)

    def test_in_one_dimension_an_end_stays(self):
        points = np.linspace(0, 1, 5)[:, None]
        cells = CellTable.from_arrays({"line": np.stack([np.arange(4), np.arange(1, 5)], axis=1)})
        surfaces = SlidingSurfaces.build(points, boundary_facets(cells), {"end": np.array([4])}, np.array([4]))
        assert surfaces.project(np.array([[0.7]])) == 1.0


class TestCurved:
    def test_circle_nodes_stay_on_the_polygon(self):
        points, cells, outer, _ = ring(64, 2)
        surfaces = SlidingSurfaces.build(points, boundary_facets(cells), {"o": outer}, outer)
        push = 0.05 * np.random.default_rng(0).standard_normal((len(outer), 2))
        slid = surfaces.project(points[outer] + push)
        assert np.max(polygon_distance(slid, points[outer])) < 1e-15
        assert np.max(np.linalg.norm(slid - points[outer], axis=1)) > 0.05  # they do slide

    def test_circle_of_fine_facets_is_kept_to_a_millionth_of_the_domain(self):
        points, cells, outer, _ = ring(3000, 1)
        surfaces = SlidingSurfaces.build(points, boundary_facets(cells), {"o": outer}, outer)
        slid = surfaces.project(points[outer] * 1.01 + [0.002, 0.001])
        assert np.max(np.abs(np.linalg.norm(slid, axis=1) - 1)) < 1e-6 * 2

    def test_rotation_along_the_circle_is_reproduced(self):
        points, cells, outer, _ = ring(720, 1)
        surfaces = SlidingSurfaces.build(points, boundary_facets(cells), {"o": outer}, outer)
        c, s = np.cos(0.2), np.sin(0.2)
        goal = points[outer] @ np.array([[c, s], [-s, c]])
        sagitta = 1 - np.cos(np.pi / 720)
        assert np.max(np.linalg.norm(surfaces.project(goal) - goal, axis=1)) <= sagitta * (1 + 1e-9)

    def test_repeated_projection_does_not_drift(self):
        points, cells, outer, _ = ring(48, 1)
        surfaces = SlidingSurfaces.build(points, boundary_facets(cells), {"o": outer}, outer)
        places = points[outer]
        for _ in range(50):
            for step in (0.003, -0.003):
                places = surfaces.project(places + np.array([step, 0.0]))
        assert np.max(polygon_distance(places, points[outer])) < 1e-15

    def test_pipe_nodes_stay_on_its_facets_and_rims_on_their_circle(self):
        points, cells, index = pipe(48, 2, 6)
        outer, end = np.unique(index[:, -1]), np.unique(index[-1])
        nodes = np.union1d(outer, end)
        surfaces = SlidingSurfaces.build(points, boundary_facets(cells), {"outer": outer, "end": end}, nodes)
        push = 0.02 * np.random.default_rng(0).standard_normal((len(nodes), 3))
        slid = surfaces.project(points[nodes] + push)
        place = dict(zip(nodes.tolist(), slid, strict=True))
        mantle = np.array([place[n] for n in np.setdiff1d(outer, end)])
        lid = np.array([place[n] for n in np.setdiff1d(end, outer)])
        rim = np.array([place[n] for n in np.intersect1d(outer, end)])
        polygon = points[index[0, -1]][:, :2]
        assert np.max(polygon_distance(mantle[:, :2], polygon)) < 1e-15
        assert (lid[:, 2] == 1).all()
        assert np.max(polygon_distance(rim[:, :2], polygon)) < 1e-15
        assert np.max(np.abs(rim[:, 2] - 1)) < 1e-15
        rim_start = points[np.intersect1d(outer, end)]
        assert np.median(np.linalg.norm(rim - rim_start, axis=1)) > 0.005  # they slide along it

    def test_triangles_and_quads_of_one_surface_work_together(self):
        points, cells, index = pipe(24, 1, 2)
        hexahedra = cells.blocks[0].nodes
        # the upper layer as wedges: its mantle is triangulated by the diagonals of quads seen from above
        lower, upper = hexahedra[: len(hexahedra) // 2], hexahedra[len(hexahedra) // 2 :]
        wedges = np.concatenate([upper[:, [0, 1, 2, 4, 5, 6]], upper[:, [0, 2, 3, 4, 6, 7]]])
        mixed = CellTable.from_arrays({"hexahedron": lower, "wedge": wedges})
        assert set(boundary_facets(mixed)) == {"quad", "triangle"}
        outer = np.unique(index[:, -1])
        surfaces = SlidingSurfaces.build(points, boundary_facets(mixed), {"o": outer}, outer)
        slid = surfaces.project(points[outer] * [1.02, 1.02, 1.0])
        assert np.max(polygon_distance(slid[:, :2], points[index[0, -1]][:, :2])) < 1e-15

    def test_corner_between_curved_sides_stays(self):
        points, cells, outer, _ = ring(8, 1)  # an octagon turns by 45° at each corner: eight planes
        surfaces = SlidingSurfaces.build(points, boundary_facets(cells), {"o": outer}, outer)
        assert np.allclose(surfaces.project(points[outer] + 0.01), points[outer], rtol=0, atol=1e-15)


def test_a_facet_of_a_plane_with_all_nodes_on_the_curved_wall_is_part_of_the_plane():
    """At a sharp rim of a pipe some facets of its end have all nodes on the pipe: these rim nodes were held."""
    mesh = box_mesh("tetra", 5)
    points, away = mesh.points.copy(), mesh.points[:, :2] - 0.5
    points[:, :2] = 0.5 + away * (np.abs(away).max(axis=1) / np.maximum(np.linalg.norm(away, axis=1), 1e-12))[:, None]
    ends = {f"z{end}": np.flatnonzero(points[:, 2] == end) for end in (0, 1)}
    wall = np.flatnonzero(((mesh.points == 0.0) | (mesh.points == 1.0))[:, :2].any(axis=1))
    nodes = np.unique(np.concatenate([wall, *ends.values()]))
    surfaces = SlidingSurfaces.build(points, boundary_facets(mesh.cells), ends | {"wall": wall}, nodes)
    assert len(surfaces.pieces) == 3
    freedom = dict(zip(surfaces.nodes.tolist(), surfaces.freedom().tolist(), strict=True))
    rim = set(wall.tolist()) & set(np.concatenate(list(ends.values())).tolist())
    assert {node for node, count in freedom.items() if count == 1} == rim


@pytest.mark.parametrize(("bend", "least"), [(0.0, 0.1), (1.0, 0.3)])
def test_spacings_on_a_curved_line_shrink_less_as_no_correction_follows(bend, least):
    along = np.linspace(0.0, 1.0, 11)
    line = WallLine(np.arange(11), np.column_stack([along, bend * along**2]))
    known = (along == 0.0) | (along == 1.0)
    crowded = np.where(known, along, 0.02 * along)
    found = line.in_order(np.column_stack([crowded, bend * crowded**2]), known)
    steps = np.linalg.norm(np.diff(found, axis=0), axis=1) / np.linalg.norm(np.diff(line.places, axis=0), axis=1)
    assert steps.min() == pytest.approx(least, rel=0.05)


def test_a_node_without_facets_is_named():
    points, cells = unit_grid(3, 3)
    with pytest.raises(InvalidInput, match="node 1 of the sliding patch 's' lies on no boundary facet"):
        SlidingSurfaces.build(points, boundary_facets(cells), {"s": np.array([1])}, np.array([1]))


def test_a_symmetry_patch_is_planar_piece_by_piece():
    points, cells = unit_grid(6, 3)
    bottom = np.flatnonzero(points[:, 1] == 0.0)
    sides = np.flatnonzero((points == 0.0).any(axis=1))
    for nodes in (bottom, sides):  # a corner between two planes is none of a curved surface
        assert SlidingSurfaces.build(points, boundary_facets(cells), {"m": nodes}, nodes, mirrors=["m"]).nodes is nodes
    points[bottom, 1] = -0.1 * np.sin(np.pi * points[bottom, 0])
    assert len(SlidingSurfaces.build(points, boundary_facets(cells), {"m": bottom}, bottom).groups)
    with pytest.raises(InvalidInput, match="symmetry patch 'm' is not planar: node") as refused:
        SlidingSurfaces.build(points, boundary_facets(cells), {"m": bottom}, bottom, mirrors=["m"])
    assert refused.value.details["node"] in bottom
    assert refused.value.hint == "give a curved surface the role slip"


def regular_body(d):
    """Corners at distance 1 from the centre, and facets: a polygon of 12 segments, an icosahedron."""
    if d == 2:
        angle = 2.0 * np.pi * np.arange(12) / 12
        return np.stack([np.cos(angle), np.sin(angle)], axis=1), np.stack(
            [np.arange(12), np.roll(range(12), -1)], axis=1
        )
    golden = (1.0 + 5.0**0.5) / 2.0
    corners = np.array([np.roll((0.0, a, b * golden), k) for k in range(3) for a in (-1, 1) for b in (-1, 1)])
    return corners / np.linalg.norm(corners[0]), ConvexHull(corners).simplices.astype(np.int64)


@pytest.mark.parametrize("d", [2, 3])
def test_a_regular_body_is_projected_from_its_centre(d):
    """Directions at the corners point away from the centre; so do those between, which are interpolated."""
    corners, facets = regular_body(d)
    constraint = OnFacets.from_simplices(corners, facets)
    rays = np.random.default_rng(d).standard_normal((500, d))
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    for radius in (0.7, 0.9, 1.0, 1.3):
        found = constraint.project(radius * rays, radius * rays)
        np.testing.assert_allclose(found / np.linalg.norm(found, axis=1)[:, None], rays, atol=1e-13)
        np.testing.assert_allclose(constraint.facets.closest(found), found, atol=1e-15)


def slope_misses(constraint: OnFacets, places: np.ndarray, reference: np.ndarray | None = None) -> np.ndarray:
    """Difference (m,) of the projection's derivative (m, d, d) from central differences."""
    rest, h = places if reference is None else reference, 1e-6
    found = constraint.slope(places, rest)
    steps = [constraint.project(places + s * h * e, rest) for e in np.eye(places.shape[1]) for s in (1, -1)]
    exact = np.stack([(there - back) / (2.0 * h) for there, back in zip(steps[::2], steps[1::2], strict=True)], axis=-1)
    return np.abs(found - exact).max(axis=(1, 2))


@pytest.mark.parametrize("d", [2, 3])
def test_the_derivative_of_a_projection_is_that_of_differences(d):
    constraint = OnFacets.from_simplices(*regular_body(d))
    rays = np.random.default_rng(d).standard_normal((500, d))
    places = rays / np.linalg.norm(rays, axis=1)[:, None] * np.linspace(0.7, 1.3, 500)[:, None]
    misses = slope_misses(constraint, places)
    assert np.sort(misses)[-5:].max() < 1e-8  # no place is within 1e-6 of a side


def test_past_the_end_of_a_curve_and_off_the_side_of_a_surface_the_nearest_place_is_differentiated():
    angle = np.linspace(0.0, np.pi, 7)
    arc = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    curve = OnFacets.from_simplices(arc, np.stack([np.arange(6), np.arange(1, 7)], axis=1))
    places = np.array([[1.1, -0.2], [-0.9, -0.3]])
    assert slope_misses(curve, places).max() < 1e-8
    assert not curve.slope(places, places).any()
    points = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.3]])
    surface = OnFacets.from_simplices(points, np.array([[0, 1, 2], [1, 3, 2]]))
    places = np.array([[0.3, -0.4, 0.1], [-0.2, 0.6, -0.2], [-0.3, -0.3, 0.1], [0.2, 0.3, 0.1]])
    assert slope_misses(surface, places).max() < 1e-8
    np.testing.assert_array_equal(np.linalg.matrix_rank(surface.slope(places, places)), [1, 1, 0, 2])


def around(radius, degrees, *along):
    angle = np.radians(degrees)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), *along], axis=-1)


def test_a_periodic_wall_of_revolution_goes_on_over_its_holes():
    """An arc, and a cone, with a hole from 20° to 30° in a sector of 50°: the places are those of the whole wall."""
    angle = np.linspace(0.0, 50.0, 51)
    period = Transform.about(np.zeros(2), np.radians(50.0))
    segments = np.stack([np.arange(50), np.arange(1, 51)], axis=1)
    hole = (angle[segments].mean(axis=1) > 20.0) & (angle[segments].mean(axis=1) < 30.0)
    arc = OnFacets.from_simplices(around(1.0, angle), segments[~hole], images=[period])
    rest, over = np.array([3.0, 12.0, 44.0, 33.0]), np.array([24.3, 25.7, 73.9, -24.4])
    found = arc.project(around(1.2, over), around(1.0, rest))
    np.testing.assert_allclose(found, around(1.0, over), atol=1e-12)
    assert slope_misses(arc, around(1.2, over), around(1.0, rest)).max() < 1e-8
    np.testing.assert_array_equal(
        arc.project(around(1.0, angle[:20]), around(1.0, angle[:20])), around(1.0, angle[:20])
    )
    wavy = around(1.0 + 0.2 * np.sin(np.radians(7.2 * angle)), angle)
    assert OnFacets.from_simplices(wavy, segments[~hole], images=[period]).turn is None
    height, facets = np.linspace(0.0, 1.0, 11), []
    for i, j in np.ndindex(50, 10):
        if not (20 <= i < 30 and 3 <= j < 7):
            a, b, c, e = i * 11 + j, (i + 1) * 11 + j, (i + 1) * 11 + j + 1, i * 11 + j + 1
            facets += [(a, b, c), (a, c, e)]
    z, degrees = np.tile(height, 51), np.repeat(angle, 11)
    period = Transform.about(np.zeros(3), np.radians(50.0), np.array([0.0, 0.0, 1.0]))
    cone = OnFacets.from_simplices(around(1.0 + 0.3 * z, degrees, z), np.array(facets), images=[period])
    z = np.full(4, 0.5)
    reference, places = around(1.15, rest, z), around(1.25, over, z)
    found = cone.project(places, reference)
    np.testing.assert_allclose(np.hypot(*found.T[:2]), 1.0 + 0.3 * found[:, 2], rtol=1e-4)  # facets of 1°
    np.testing.assert_allclose(np.arctan2(found[:, 1], found[:, 0]), np.radians(over), atol=2e-3)
    assert slope_misses(cone, places, reference).max() < 1e-7


@pytest.mark.parametrize("d", [2, 3])
def test_the_derivative_at_a_corner_is_that_onto_the_tangent_plane(d):
    """The mean over the adjacent facets, which are equal in a regular body."""
    corners, facets = regular_body(d)
    found = OnFacets.from_simplices(corners, facets).slope(corners, corners)
    plane = np.eye(d) - corners[:, :, None] * corners[:, None, :]
    along = np.einsum("mij,mjk->mik", plane, found)
    np.testing.assert_allclose(along, plane, atol=1e-12)
    np.testing.assert_allclose(found, plane, atol=1e-12)


@pytest.mark.parametrize("d", [2, 3])
def test_a_node_does_not_jump_over_a_kink(d):
    corners, facets = regular_body(d)
    constraint = OnFacets.from_simplices(corners, facets)
    angle = np.linspace(0.0, 2.0 * np.pi, 4000)
    path = 0.9 * np.column_stack([np.cos(angle), np.sin(angle), 0.3 * np.sin(3.0 * angle)])[:, :d]
    speeds = [
        (np.linalg.norm(np.diff(way, axis=0), axis=1) / np.linalg.norm(np.diff(path, axis=0), axis=1)).max()
        for way in (constraint.project(path, path), constraint.facets.closest(path))
    ]
    assert speeds[0] < 1.5
    assert speeds[1] > 10.0
