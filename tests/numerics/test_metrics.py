"""Known cells have known qualities at any place, angle and scale; NaN is the worst quality."""

import numpy as np
import pytest
from box_meshes import box_mesh
from frame_meshes import tensor_grid
from hypothesis import given
from hypothesis import strategies as st
from mesh_motion_numerics.mesh.cells import CELL_TYPES, CellTable
from mesh_motion_numerics.method import KEYS
from mesh_motion_numerics.quality.metrics import (
    METRIC_CODES,
    QUALITY_METRICS,
    cell_quality,
    cells_at_rest,
    reference_sizes,
    subset_quality,
)
from mesh_motion_numerics.quality.quality_summary import judged_mesh
from mesh_motion_protocol.errors import InvalidInput
from thread_counts import on_one_and_on_all_threads

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
CUBE = np.vstack([np.c_[SQUARE, np.zeros(4)], np.c_[SQUARE, np.ones(4)]])
TRIANGLE = np.array([[0.0, 0.0], [1.0, 0.0], [0.5, 3**0.5 / 2]])
IDEAL = {
    "line": np.array([[0.0], [1.0]]),
    "triangle": TRIANGLE,
    "quad": SQUARE,
    "tetra": np.vstack([np.zeros(3), CELL_TYPES["tetra"].ideal_array.T]),
    "hexahedron": CUBE,
    "wedge": np.vstack([np.c_[TRIANGLE, np.zeros(3)], np.c_[TRIANGLE, np.ones(3)]]),
    "pyramid": np.vstack([CUBE[:4], [[0.5, 0.5, 0.5**0.5]]]),
}
ALL_TYPES = pytest.mark.parametrize("name", CELL_TYPES)


def one_cell(name: str) -> CellTable:
    return CellTable.from_arrays({name: np.arange(CELL_TYPES[name].n_nodes)[None]})


def quality_of(name: str, points: np.ndarray, reference: np.ndarray | None = None):
    cells = one_cell(name)
    return cell_quality(points, cells, cells_at_rest(points if reference is None else reference, cells))


def rotation(rng: np.random.Generator, d: int) -> np.ndarray:
    q, _ = np.linalg.qr(rng.normal(size=(d, d)))
    q[:, 0] *= np.sign(np.linalg.det(q))
    return q


def grid(n: int) -> tuple[np.ndarray, CellTable]:
    """(n² nodes, 2 (n - 1)² triangles) of the unit square, perturbed but valid."""
    rng = np.random.default_rng(3)
    xy, quads = tensor_grid(*[np.arange(n) / (n - 1)] * 2)
    cells = CellTable.from_arrays({"triangle": np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])})
    return xy + rng.uniform(-0.2, 0.2, xy.shape) / (n - 1), cells


@ALL_TYPES
def test_the_ideal_cell_is_perfect(name):
    quality = quality_of(name, IDEAL[name])
    for metric in QUALITY_METRICS:
        assert quality.metric(metric)[0] == pytest.approx(1.0, abs=4e-15), metric
    assert not quality.inverted[0]


@ALL_TYPES
@given(seed=st.integers(0, 2**32 - 1), scale=st.floats(1e-6, 1e6))
def test_position_and_angle_do_not_matter_and_scale_matters_only_for_size(name, seed, scale):
    rng = np.random.default_rng(seed)
    d = CELL_TYPES[name].dimension
    cell = IDEAL[name] + 0.1 * rng.normal(size=IDEAL[name].shape)
    moved = scale * cell @ rotation(rng, d).T + scale * rng.normal(size=d)
    before, after = quality_of(name, cell), quality_of(name, moved, reference=cell)
    assert 0.0 <= before.skew[0] <= 1.0 + 1e-14
    assert after.skew[0] == pytest.approx(before.skew[0], rel=1e-9, abs=1e-9)
    assert after.size[0] == pytest.approx(min(scale**d, scale**-d), rel=1e-9)
    assert after.inverted[0] == before.inverted[0]


@pytest.mark.parametrize(
    ("name", "points", "skew"),
    [
        ("triangle", [[0, 0], [1, 0], [0, 1]], 3**0.5 / 2),  # right isosceles
        ("triangle", [[0, 0], [2, 0], [0, 1]], 2 * 3**0.5 / 5),  # √3·2/(4 + 1)
        ("quad", [[0, 0], [5, 0], [5, 1], [0, 1]], 1.0),  # right angles are perfect at any aspect ratio
        ("quad", [[0, 0], [1, 0], [1.5, 3**0.5 / 2], [0.5, 3**0.5 / 2]], 3**0.5 / 2),  # rhombus of 60 degrees
        ("tetra", [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], 3 * 2 ** (1 / 3) / 4.5),  # corner of the cube
        ("hexahedron", CUBE * [1, 2, 3], 1.0),
        ("hexahedron", CUBE @ [[1, 0, 0], [0.5, 3**0.5 / 2, 0], [0, 0, 1]], (3**0.5 / 2) ** (2 / 3)),
        ("wedge", IDEAL["wedge"] * [1, 1, 1e-3], 1.0),  # a boundary layer's prism
        (
            "wedge",  # on a right isosceles triangle: angles 90, 45, 45
            CUBE[[0, 1, 3, 4, 5, 7]],
            3 / ((3**0.5 / 2) ** (2 / 3) * (1 + 2 * 2 ** (1 / 3))),
        ),
        ("pyramid", IDEAL["pyramid"] * [1, 1, 2], 3 * 2 ** (2 / 3) / (1 + 1 + 4)),  # stretches 1, 1, 2
        ("line", [[0.0], [7.0]], 1.0),
    ],
)
def test_known_skews(name, points, skew):
    assert quality_of(name, np.array(points, dtype=float)).skew[0] == pytest.approx(skew, rel=1e-14)


@pytest.mark.parametrize(
    ("stretch", "size"), [(1.0, 1.0), (0.5, 0.5), (2.0, 0.5), (-0.5, -0.5), (-1.0, -1.0), (-4.0, -0.25), (0.0, 0.0)]
)
@ALL_TYPES
def test_size_is_the_smaller_of_growth_and_shrinkage_and_knows_the_sign(name, stretch, size):
    points = IDEAL[name] * np.array([stretch] + [1.0] * (CELL_TYPES[name].dimension - 1))
    quality = quality_of(name, points, reference=IDEAL[name])
    assert quality.size[0] == pytest.approx(size, abs=1e-15)
    assert quality.inverted[0] == (stretch <= 0)
    assert (quality.skew[0] > 0) == (stretch != 0)


def test_the_metrics_are_what_their_names_say():
    points = TRIANGLE * [0.5, 1.0]
    quality = quality_of("triangle", points, reference=TRIANGLE)
    size, skew = quality.size[0], quality.skew[0]
    assert quality.metric("size-skew")[0] == pytest.approx(np.sqrt(size) * skew)
    assert quality.metric("size-skew-root")[0] == pytest.approx(np.sqrt(size * skew))
    assert quality.metric("size-skew-product")[0] == pytest.approx(size * skew)
    mirrored = quality_of("triangle", points * [-1.0, 1.0], reference=TRIANGLE)
    for metric in ("size", "size-skew", "size-skew-root", "size-skew-product"):
        assert mirrored.metric(metric)[0] == pytest.approx(-quality.metric(metric)[0])


@pytest.mark.parametrize(
    ("name", "node", "place"),
    [("quad", 2, (0.2, 0.2)), ("hexahedron", 6, (0.1, 0.1, 0.1)), ("wedge", 5, (0.5, 0.3, -0.2))],
)
def test_a_cell_with_some_inverted_corners_has_no_shape(name, node, place):
    points = IDEAL[name].copy()
    points[node] = place
    quality = quality_of(name, points, reference=IDEAL[name])
    assert quality.inverted[0]
    assert quality.size[0] > 0
    assert quality.skew[0] == 0


@ALL_TYPES
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_position_that_is_no_number_is_the_worst(name, value):
    points = IDEAL[name].copy()
    points[-1, 0] = value
    quality = quality_of(name, points, reference=IDEAL[name])
    assert quality.inverted[0]
    cells = one_cell(name)
    for metric in QUALITY_METRICS:
        assert quality.metric(metric)[0] == -np.inf
        lowest = judged_mesh(points, cells, cells_at_rest(IDEAL[name], cells), metric=metric, distributions=False)[0]
        assert (lowest.metric.min, lowest.worst[0].number, lowest.inverted) == (-np.inf, 0, 1)


@ALL_TYPES
def test_a_cell_without_extent_is_degenerate_not_unknown(name):
    quality = quality_of(name, np.zeros_like(IDEAL[name]), reference=IDEAL[name])
    assert (quality.size[0], quality.skew[0], quality.inverted[0]) == (0.0, 0.0, True)


def test_threads_do_not_change_a_bit():
    points, cells = grid(300)
    sizes = reference_sizes(points, cells)
    moved = points + 0.3 * np.sin(3 * points[:, ::-1])
    one, all_of_them = on_one_and_on_all_threads(lambda: cell_quality(moved, cells, sizes))
    for name in ("size", "skew"):
        assert getattr(one, name).tobytes() == getattr(all_of_them, name).tobytes()
    assert one.metric("size-skew").tobytes() == all_of_them.metric("size-skew").tobytes()


def test_unknown_names_and_wrong_shapes_are_refused_in_words():
    points, cells = grid(3)
    sizes = reference_sizes(points, cells)
    with pytest.raises(InvalidInput, match="unknown quality metric 'shape'; known are size, skew, size-skew"):
        judged_mesh(points, cells, sizes, metric="shape", distributions=False)[0]
    with pytest.raises(InvalidInput, match=r"expected an array of shape \(n, 2\) for 2D cells, got \(9, 3\)") as caught:
        cell_quality(np.zeros((9, 3)), cells, sizes)
    assert caught.value.code == "INVALID_ARGUMENT.SHAPE"


def test_a_method_offers_every_metric():
    assert set(KEYS["quality_metric"].choices) == set(QUALITY_METRICS) == set(METRIC_CODES)


@ALL_TYPES
def test_relative_size_skew_is_one_at_rest_and_after_a_rigid_motion_whatever_the_cell_looks_like(name):
    rng = np.random.default_rng(5)
    d = CELL_TYPES[name].dimension
    flat = IDEAL[name] * np.array([1.0, 1e-4, 1.0])[:d] + 1e-6 * rng.random((len(IDEAL[name]), d))
    turn = rotation(rng, d)
    for points in (flat, flat @ turn.T + 3.0):
        quality = quality_of(name, points, reference=flat)
        assert quality.metric("relative-size-skew")[0] == pytest.approx(1.0, abs=1e-6)


def test_relative_size_skew_of_a_flat_triangle_falls_with_its_height_and_needs_the_cells_at_rest():
    flat = np.array([[0.0, 0.0], [1.0, 0.0], [0.5, 1e-3]])
    lower = flat * [1.0, 0.25]
    quality = quality_of("triangle", lower, reference=flat)
    assert quality.metric("relative-size-skew")[0] == pytest.approx(0.5 * 0.25, rel=1e-4)
    higher = quality_of("triangle", flat * [1.0, 2.0], reference=flat)
    assert higher.metric("relative-size-skew")[0] == pytest.approx(np.sqrt(0.5), rel=1e-4)  # no better than at rest
    cells = one_cell("triangle")
    bare = cell_quality(flat, cells, reference_sizes(flat, cells))
    with pytest.raises(InvalidInput, match="needs the cells at rest"):
        bare.metric("relative-size-skew")


@pytest.mark.parametrize("name", [name for name, kind in CELL_TYPES.items() if not kind.is_simplex])
def test_relative_shape_sees_angles_and_aspect_ratio(name):
    """The mesh motion's gradient T is known: an affine map has the same T at any corner of any cell."""
    rng = np.random.default_rng(6)
    d = CELL_TYPES[name].dimension
    rest = IDEAL[name] * np.array([1.0, 0.05, 1.0])[:d] + 1e-3 * rng.random((len(IDEAL[name]), d))
    for gradient in (np.diag([3.0, 1 / 3, 1.0][:d]), np.eye(d) + 0.3 * rng.random((d, d))):
        square, det = np.sum(gradient**2), np.linalg.det(gradient)
        found = quality_of(name, rest @ gradient.T, reference=rest)
        assert found.relative_shape[0] == pytest.approx(d * det ** (2 / d) / square, rel=1e-12)
        assert found.metric("relative-size-skew")[0] == pytest.approx(
            np.sqrt(min(det, 1 / det)) * found.relative_shape[0], rel=1e-12
        )


@pytest.mark.parametrize("name", [name for name, kind in CELL_TYPES.items() if not kind.is_simplex])
def test_relative_shape_is_that_of_the_worst_corner(name):
    rng = np.random.default_rng(7)
    rest = IDEAL[name] + 0.05 * rng.random(IDEAL[name].shape)
    moved = rest + 0.2 * rng.random(rest.shape)
    d, shapes = rest.shape[1], []
    for corner in CELL_TYPES[name].corner_array:
        before, after = ((points[corner[1:]] - points[corner[0]]).T for points in (rest, moved))
        gradient = after @ np.linalg.inv(before)
        shapes.append(d * np.linalg.det(gradient) ** (2 / d) / np.sum(gradient**2))
    assert quality_of(name, moved, reference=rest).relative_shape[0] == pytest.approx(min(shapes), rel=1e-12)


def test_a_corner_that_is_flat_at_rest_is_not_compared_but_must_not_turn():
    flat = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.5 - 1e-9, 0.5 + 1e-9]])  # 180 degrees at node 3
    assert quality_of("quad", flat * [2.0, 2.0], reference=flat).relative_shape[0] == pytest.approx(1.0)
    turned = flat + np.array([[0, 0], [0, 0], [0, 0], [0.1, -0.1]])
    assert quality_of("quad", turned, reference=flat).metric("relative-size-skew")[0] <= 0.0


def test_relative_shapes_of_some_cells_are_those_of_all():
    mesh = box_mesh("quad + triangle", 6)
    rest, moved = mesh.points + 0.02 * np.random.default_rng(8).random((2, *mesh.points.shape))
    at_rest = cells_at_rest(rest, mesh.cells)
    numbers = np.array([3, 11, 17, len(mesh.cells) - 1])
    some, every = (of(moved, mesh.cells, at_rest, *n) for of, n in ((subset_quality, (numbers,)), (cell_quality, ())))
    for name in ("size", "skew", "inverted", "relative_shape"):
        assert getattr(some, name).tobytes() == getattr(every, name)[numbers].tobytes(), name
    for distributions in (True, False):
        choices = {"metric": "relative-size-skew", "worst": 1, "distributions": distributions}
        found, _ = judged_mesh(moved, mesh.cells, at_rest, **choices)
        assert found.metric.min == every.metric("relative-size-skew").min()
