"""The C library, built as numerics/kernels/README.md says, has the bits of the Python module; its examples run;
a wrong argument gives a number and a message.
"""

import ctypes
import os
import re
from collections.abc import Callable
from ctypes import byref, c_char_p, c_double, c_int64, c_void_p
from pathlib import Path
from typing import Any, NamedTuple

import mesh_motion_kernels as kernels
import numpy as np
import pytest
from box_meshes import box_mesh
from mesh_motion_numerics.interpolation import evaluation
from mesh_motion_numerics.interpolation.centres import CentreLayout
from mesh_motion_numerics.interpolation.interpolant import Interpolant, factorize
from mesh_motion_numerics.interpolation.kernels import BASES
from mesh_motion_numerics.interpolation.polynomial import LinearBasis, Polynomial
from mesh_motion_numerics.interpolation.two_scale.interpolant import TwoScaleInterpolant
from mesh_motion_numerics.interpolation.two_scale.nested_grid import NestedSpline
from mesh_motion_numerics.mesh.boundary_facets import boundary_facets
from mesh_motion_numerics.mesh.cells import CELL_TYPES, CellTable
from mesh_motion_numerics.quality.metrics import METRIC_CODES, QUALITY_METRICS, cell_quality, cells_at_rest, judged
from numpy.typing import NDArray
from programs import need, run

pytestmark = pytest.mark.nightly

SOURCE = Path(__file__).resolve().parents[2] / "numerics" / "kernels"
WARNINGS = ["-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror"]
WRITE, ADD, INVALID_ARGUMENT = 0, 1, 3
Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def library(c_kernels: Path) -> ctypes.CDLL:
    """The library with two threads on any machine."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MESH_MOTION_THREADS", "2")
        loaded = ctypes.CDLL(str(c_kernels / "lib" / "libmesh_motion_kernels.so"))
        loaded.mesh_motion_kernels_error.restype = c_char_p
        assert loaded.mesh_motion_available_threads() == 2
    return loaded


def pointer(array: Array | NDArray[Any] | None) -> c_void_p | None:
    return None if array is None else array.ctypes.data_as(c_void_p)


class Handle:
    """An object that a call has made; it is freed with this one."""

    def __init__(self, library: ctypes.CDLL, kind: str, *arguments: Any) -> None:
        self.library, self.kind, self.at = library, kind, c_void_p()
        self.made = getattr(library, f"mesh_motion_{kind}_create")(*arguments, byref(self.at))

    def __del__(self) -> None:
        getattr(self.library, f"mesh_motion_{self.kind}_free")(self.at)

    def evaluate(self, what: str, points: Array, out: Array, mode: int = WRITE) -> Array:
        call = getattr(self.library, f"mesh_motion_{self.kind}_{what}")
        result = call(self.at, c_int64(len(points)), pointer(points), mode, pointer(out))
        assert result == 0, self.library.mesh_motion_kernels_error()
        return out


def interpolant_handle(library: ctypes.CDLL, field: Interpolant) -> Handle:
    points, weights = np.ascontiguousarray(field.control_points), np.ascontiguousarray(field.weights)
    made = Handle(library, "interpolant", field.basis.name.encode(), c_double(field.support_radius),
                  c_int64(points.shape[1]), c_int64(len(points)), pointer(points), c_int64(field.components),
                  pointer(weights))  # fmt: skip
    assert made.made == 0, library.mesh_motion_kernels_error()
    if field.polynomial is not None:
        basis, b = field.polynomial.basis, np.ascontiguousarray(field.polynomial.coefficients)
        set_polynomial = library.mesh_motion_interpolant_set_polynomial
        assert set_polynomial(made.at, pointer(basis.centre), c_double(basis.scale), pointer(b)) == 0
    return made


def spline_handle(library: ctypes.CDLL, spline: NestedSpline) -> Handle:
    rows, components = spline.coefficients.shape
    return Handle(library, "spline", c_int64(spline.dimension), c_int64(len(spline.start)), pointer(spline.origin),
                  pointer(spline.inverse_spacing), pointer(spline.cells), pointer(spline.start), c_int64(rows),
                  c_int64(components), pointer(spline.coefficients))  # fmt: skip


def interpolant(
    basis: str, d: int, k: int, radius: float, *, polynomial: bool = False, n: int = 700, clusters: int = 0
) -> Interpolant:
    rng = np.random.default_rng([d, k, n])
    points, weights, row = rng.random((n, d)), rng.normal(size=(n, k)), BASES[basis]
    if clusters:
        points = points[np.arange(n) % clusters] + 0.6 * radius * points
    linear = Polynomial(LinearBasis.around(points), rng.normal(size=(d + 1, k))) if polynomial else None
    return Interpolant(points, weights, row, radius, CentreLayout.build(points, row, radius), linear)


def places(d: int, n: int = 3000) -> Array:
    rng = np.random.default_rng(7)
    return np.vstack([rng.random((n, d)), rng.uniform(-1.0, 2.0, (n // 4, d)), 1e6 * rng.normal(size=(20, d))])


def nested_spline(d: int, k: int) -> NestedSpline:
    cells = np.array([[4, 4, 4], [5, 6, 7]]) * (np.arange(3) < d)
    counts = np.prod(np.where(cells > 0, cells + 3, 1), axis=1)
    origin, inverse = np.array([[0.3] * 3, [0.0] * 3]), np.array([20.0, 5.0])
    coefficients = np.random.default_rng(d).normal(size=(counts.sum(), k))
    return NestedSpline(origin, inverse, cells, np.array([0, counts[0]]), coefficients, d)


@pytest.mark.parametrize("d", [1, 2, 3])
@pytest.mark.parametrize("basis", BASES)
def test_an_interpolant_has_the_bits_of_the_server(library: ctypes.CDLL, basis: str, d: int) -> None:
    points = places(d)
    for radius, k, polynomial in ((0.07, d, False), (0.9, 4, True)):
        field = interpolant(basis, d, k, radius, polynomial=polynomial)
        handle = interpolant_handle(library, field)
        found = handle.evaluate("values", points, np.empty((len(points), k)))
        assert found.tobytes() == evaluation.displacement(field, points).tobytes()
        if field.basis.gradient_at_centre:
            found = handle.evaluate("gradients", points, np.empty((len(points), k, d)))
            assert found.tobytes() == evaluation.gradient(field, points).tobytes()
        if not field.basis.compact or polynomial:
            start = np.ones((len(points), k))
            added = handle.evaluate("values", points, start.copy(), ADD)
            assert added.tobytes() == (start + evaluation.displacement(field, points)).tobytes()


@pytest.mark.parametrize("coarse", ["spline", "interpolant"])
@pytest.mark.parametrize(("d", "k"), [(1, 1), (2, 2), (3, 3), (3, 5)])
def test_two_scales_have_the_bits_of_the_server(library: ctypes.CDLL, d: int, k: int, coarse: str) -> None:
    # the last level is so narrow compared with the cube that the cells of its layout are much wider than its radius
    narrow = interpolant("wendland-c2", d, k, 1e-5, n=300, clusters=10)
    levels = (*(interpolant("wendland-c2", d, k, radius, n=300) for radius in (0.3, 0.05)), narrow)
    assert narrow.layout.inverse_side * narrow.support_radius < 0.5
    wide = nested_spline(d, k) if coarse == "spline" else interpolant("tps", d, k, 1.0, polynomial=True, n=40)
    field = TwoScaleInterpolant(wide, levels)
    points = np.vstack([places(d), levels[0].control_points, narrow.control_points + 2e-6])
    handles = [spline_handle(library, wide) if isinstance(wide, NestedSpline) else interpolant_handle(library, wide)]
    handles += [interpolant_handle(library, level) for level in levels]
    values, gradients = np.empty((len(points), k)), np.empty((len(points), k, d))
    for handle, mode in zip(handles, (WRITE, ADD, ADD, ADD), strict=True):
        handle.evaluate("values", points, values, mode)
        handle.evaluate("gradients", points, gradients, mode)
    assert values.tobytes() == evaluation.displacement(field, points).tobytes()
    assert gradients.tobytes() == evaluation.gradient(field, points).tobytes()


@pytest.mark.parametrize(("d", "k"), [(1, 1), (2, 2), (3, 3), (3, 5)])
def test_counts_of_coefficients_have_the_bits_of_the_server(library: ctypes.CDLL, d: int, k: int) -> None:
    spline, points = nested_spline(d, k), places(d)
    weights, counts = np.random.default_rng(5).normal(size=(len(points), k)), spline.coefficients.copy()
    arguments = c_int64(len(points)), pointer(points), c_int64(k), pointer(weights), pointer(counts)
    handle = spline_handle(library, spline)
    assert library.mesh_motion_spline_counts(handle.at, *arguments) == 0
    spline.count(points, weights)
    assert counts.tobytes() == spline.coefficients.tobytes()


class Facets(ctypes.Structure):
    _fields_ = [("count", c_int64), ("nodes", ctypes.POINTER(c_int64))]


@pytest.mark.parametrize("kind", ["quad + triangle", "tetra", "hexahedron", "wedge", "pyramid"])
def test_the_facets_of_the_boundary_are_those_of_the_server(library: ctypes.CDLL, kind: str) -> None:
    cells = box_mesh(kind, 4).cells
    held = cells_handle(library, cells)
    handle = Handle(library, "facets", held.at)
    facets = ctypes.cast(handle.at, ctypes.POINTER(Facets)).contents
    rows = np.ctypeslib.as_array(facets.nodes, (facets.count, 4))
    sizes = np.count_nonzero(rows >= 0, axis=1)
    for expected in boundary_facets(cells).values():
        size = expected.shape[1]
        np.testing.assert_array_equal(rows[sizes == size, :size], expected)
        sizes[sizes == size] = 0
    assert not sizes.any()


class Distribution(ctypes.Structure):
    _fields_ = [(name, c_double) for name in ("minimum", "mean", "p1", "p5", "p50")]


class Quality(ctypes.Structure):
    _fields_ = [*((name, Distribution) for name in ("size", "skew", "size_skew", "metric")), ("inverted", c_int64)]


class Mesh(NamedTuple):
    cells: CellTable
    rest: Array
    moved: Array


def mesh(names: tuple[str, ...], count: int) -> Mesh:
    """Disturbed ideal cells without common nodes; some are inverted, and one of several has no finite position."""
    rng, d = np.random.default_rng(count), CELL_TYPES[names[0]].dimension
    cube = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]], float)
    corners = {"tetra": cube[[0, 1, 3, 4]], "hexahedron": cube, "pyramid": cube[:5], "quad": cube[:4],
               "wedge": cube[[0, 1, 3, 4, 5, 7]], "triangle": cube[[0, 1, 3]], "line": cube[:2]}  # fmt: skip
    blocks, points, first = {}, [], 0
    for name in names:
        shape = corners[name][:, :d]
        points.append((shape + 0.1 * rng.normal(size=(count, *shape.shape))).reshape(-1, d))
        blocks[name] = first + np.arange(count * len(shape)).reshape(count, -1)
        first += count * len(shape)
    rest = np.vstack(points)
    moved = rest + 0.2 * rng.normal(size=rest.shape)
    moved[3:4] = np.nan
    return Mesh(CellTable.from_arrays(blocks), rest, moved)


def cells_handle(library: ctypes.CDLL, cells: CellTable) -> Handle:
    made = Handle(library, "cells")
    for block in cells:
        name, nodes = block.type.name.encode(), pointer(block.nodes.astype(np.int64))
        assert library.mesh_motion_cells_add(made.at, name, c_int64(len(block)), nodes) == 0
    return made


MESHES = [*((name,) for name in CELL_TYPES), ("triangle", "quad"), ("tetra", "hexahedron", "wedge", "pyramid")]


@pytest.mark.parametrize("count", [1, 300, 9000])
@pytest.mark.parametrize("names", MESHES)
def test_cells_are_judged_with_the_bits_of_the_server(library: ctypes.CDLL, names: tuple[str, ...], count: int) -> None:
    cells, rest, moved = mesh(names, count)
    handle, n, m = cells_handle(library, cells), c_int64(len(rest)), len(cells)
    known = cells_at_rest(rest, cells)
    sizes = np.empty(m)
    assert library.mesh_motion_cell_sizes(handle.at, n, pointer(rest), pointer(sizes)) == 0
    assert sizes.tobytes() == known.sizes.tobytes()

    expected = cell_quality(moved, cells, known)
    size, skew, inverted = np.empty(m), np.empty(m), np.empty(m, dtype=np.bool_)
    arrays = pointer(sizes), pointer(size), pointer(skew), pointer(inverted)
    assert library.mesh_motion_cell_quality(handle.at, n, pointer(moved), *arrays) == 0
    assert (size.tobytes(), skew.tobytes()) == (expected.size.tobytes(), expected.skew.tobytes())
    np.testing.assert_array_equal(inverted, expected.inverted)

    for metric in QUALITY_METRICS:
        asked = 10
        numbers, values, turned, quality = np.empty(asked, np.int64), np.empty(asked), c_int64(), Quality()
        relative = metric == "relative-size-skew"
        at_rest_arrays = (pointer(known.skews), pointer(known.points)) if relative else (None, None)
        arrays = handle.at, n, pointer(moved), pointer(sizes), *at_rest_arrays
        passed = *arrays, metric.encode(), c_int64(asked), pointer(numbers)
        arrays = judged(moved, cells, known, metric)
        lowest = kernels.lowest_cells(*arrays, asked, 0.0)
        rows, _, bad, _ = kernels.judged_cells(*arrays, asked, 0.0)
        for call, last in (("lowest", turned), ("judge", quality)):
            numbers[:], values[:] = 0, 0.0
            assert getattr(library, f"mesh_motion_{call}_cells")(*passed, pointer(values), byref(last)) == 0
            assert values.tobytes() == np.append(lowest[0], [np.inf] * (asked - len(lowest[0]))).tobytes()
            np.testing.assert_array_equal(numbers, np.append(lowest[1], [-1] * (asked - len(lowest[1]))))
        assert turned.value == quality.inverted == bad == np.count_nonzero(expected.inverted)
        found = np.frombuffer(bytes(quality)[:-8]).reshape(4, 5)
        assert found.tobytes() == rows[[0, 1, 2, min(METRIC_CODES[metric], 3)]].tobytes()


def test_no_cells_have_no_worst_one(library: ctypes.CDLL) -> None:
    """Arguments of a rank without cells."""
    handle, numbers, values, inverted = Handle(library, "cells"), np.empty(2, np.int64), np.empty(2), c_int64(5)
    passed = None, None, None, None, b"size-skew", c_int64(2), pointer(numbers), pointer(values)
    assert library.mesh_motion_lowest_cells(handle.at, c_int64(0), *passed, byref(inverted)) == 0
    assert (numbers.tolist(), values.tolist(), inverted.value) == ([-1, -1], [np.inf, np.inf], 0)


def test_threads_do_not_change_bits(library: ctypes.CDLL) -> None:
    field, points, found = interpolant("wendland-c2", 3, 3, 0.2, n=3000), places(3, 20000), []
    cells, rest, moved = mesh(("tetra",), 40000)
    handle, judging, sizes = interpolant_handle(library, field), cells_handle(library, cells), np.empty(len(cells))
    for threads in (1, 2):
        assert library.mesh_motion_set_threads(threads) == 0
        assert library.mesh_motion_get_threads() == threads
        values, gradients = np.empty((len(points), 3)), np.empty((len(points), 3, 3))
        handle.evaluate("values", points, handle.evaluate("values", points, values), ADD)
        handle.evaluate("gradients", points, gradients)
        n, quality = c_int64(len(rest)), Quality()
        library.mesh_motion_cell_sizes(judging.at, n, pointer(rest), pointer(sizes))
        passed = pointer(moved), pointer(sizes), None, None, b"size-skew", c_int64(0), None, None
        assert library.mesh_motion_judge_cells(judging.at, n, *passed, byref(quality)) == 0
        found.append((values.tobytes(), gradients.tobytes(), bytes(quality)))
    assert found[0] == found[1]


THREE, NODES = np.zeros(6), np.array([0, 1, 2, 3, 4, 5])


def _interpolant(basis: bytes | None = b"gauss", radius: float = 1.0, d: int = 2, n: int = 3, k: int = 1,
                 points: Array | None = THREE, weights: Array | None = THREE) -> tuple[Any, ...]:  # fmt: skip
    return "interpolant", basis, c_double(radius), c_int64(d), c_int64(n), pointer(points), c_int64(k), pointer(weights)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (_interpolant(b"wendland"), "basis: expected one of wendland-c2, .*, gauss, got 'wendland'"),
        (_interpolant(None), "basis: expected a pointer that is not NULL"),
        (_interpolant(radius=0.0), "support_radius: expected a finite number > 0"),
        (_interpolant(radius=np.nan), "support_radius: expected a finite number > 0"),
        (_interpolant(d=4), "dimension: expected 1, 2 or 3"),
        (_interpolant(n=-1), "control_points: expected lengths that are not negative"),
        (_interpolant(k=0), "components: expected at least one"),
        (_interpolant(k=2**62), "weights: expected an array that fits into memory"),
        (_interpolant(points=None), "control_points: expected a pointer that is not NULL"),
        (_interpolant(weights=np.full(3, np.inf)), "weights: expected finite numbers"),
        (("spline", c_int64(3), c_int64(0), None, None, None, None, c_int64(0), c_int64(1), None), "cells: expected"),
    ],
)  # fmt: skip
def test_wrong_arguments_of_a_constructor_are_refused(
    library: ctypes.CDLL, arguments: tuple[Any, ...], message: str
) -> None:
    handle = Handle(library, *arguments)
    assert handle.made == INVALID_ARGUMENT
    assert handle.at.value is None
    assert re.match(message, library.mesh_motion_kernels_error().decode())


Call = Callable[[ctypes.CDLL, c_void_p, c_void_p], int]
ONE, FIVE, EIGHT, PLANE = c_int64(1), c_int64(5), c_int64(8), np.zeros(16)


def _judge(metric: bytes) -> Call:
    passed = pointer(PLANE), pointer(THREE), None, None, metric, c_int64(0), None, None, None
    return lambda c, cells, _: int(c.mesh_motion_judge_cells(cells, EIGHT, *passed))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda c, _, f: c.mesh_motion_interpolant_values(None, EIGHT, None, WRITE, None), "interpolant: .* not NULL"),
        (lambda c, _, f: c.mesh_motion_interpolant_values(f, EIGHT, None, WRITE, None), "points: .* not NULL"),
        (lambda c, _, f: c.mesh_motion_interpolant_values(f, ONE, pointer(THREE), 2, pointer(THREE)), "mode: expected"),
        (lambda c, _, f: c.mesh_motion_interpolant_gradients(f, ONE, None, WRITE, None), ".* with a gradient"),
        (lambda c, _, f: c.mesh_motion_interpolant_set_polynomial(f, pointer(THREE), c_double(0.0), None), "scale: "),
        (lambda c, m, _: c.mesh_motion_cells_add(m, b"square", EIGHT, pointer(NODES)), "type: .* got 'square'"),
        (lambda c, m, _: c.mesh_motion_cells_add(m, b"tetra", ONE, pointer(NODES)), "type: .* one dimension"),
        (lambda c, m, _: c.mesh_motion_cells_add(m, b"quad", ONE, pointer(NODES - 1)), "nodes: .* from 0 to"),
        (lambda c, m, _: c.mesh_motion_cell_sizes(m, FIVE, pointer(THREE), None), "n: .* the 6 nodes .*, got 5"),
        (_judge(b"relative-size-skew"), "rest: expected the skews and points at rest"),
        (_judge(b"beauty"), "metric: .* got 'beauty'"),
        (lambda c, _, f: c.mesh_motion_set_threads(3), "expected 1 thread to as many as are available"),
    ],
)
def test_wrong_arguments_are_refused(library: ctypes.CDLL, call: Call, message: str) -> None:
    cells, field = Handle(library, "cells"), interpolant_handle(library, interpolant("ctps-c0", 2, 1, 0.1))
    assert library.mesh_motion_cells_add(cells.at, b"triangle", c_int64(2), pointer(NODES)) == 0
    assert call(library, cells.at, field.at) == INVALID_ARGUMENT
    assert re.match(message, library.mesh_motion_kernels_error().decode())


def square_in_a_square() -> tuple[CellTable, Array, Array]:
    j, i = np.divmod(np.arange(169), 13)
    hole = (i > 4) & (i < 8) & (j > 4) & (j < 8)
    number = np.where(hole, -1, np.cumsum(~hole) - 1).reshape(13, 13)
    quads = np.stack([number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]], axis=-1)
    outside = np.ones((12, 12), dtype=bool)
    outside[4:8, 4:8] = False
    i, j = i[~hole], j[~hole]
    points = np.column_stack([i, j]) / 12
    inner = (i >= 4) & (i <= 8) & (j >= 4) & (j <= 8)
    control = inner | (i % 12 == 0) | (j % 12 == 0)
    turned = (points - 0.5) @ [[-0.2, 0.6], [-0.6, -0.2]] + [0.03, 0.02]
    given = np.where(inner[:, None], turned, 0.0)[control]
    field = factorize(points[control], basis="wendland-c2", support_radius=0.8).solve(given)
    return CellTable.from_arrays({"quad": quads[outside]}), points, evaluation.displacement(field, points)


@pytest.mark.parametrize(
    "compiler",
    [
        ["gcc", "-std=c11", SOURCE / "examples" / "evaluate.c"],
        [
            "gfortran",
            "-std=f2008",
            SOURCE / "fortran" / "mesh_motion_kernels.f90",
            SOURCE / "examples" / "evaluate.f90",
        ],
    ],
    ids=["c", "fortran"],
)
def test_the_examples_move_and_judge_a_mesh(c_kernels: Path, tmp_path: Path, compiler: list[Any]) -> None:
    need(compiler[0], "pkg-config")
    environment = os.environ | {"PKG_CONFIG_PATH": str(c_kernels / "lib" / "pkgconfig")}
    flags = run("pkg-config", "--cflags", "--libs", "mesh_motion_kernels", env=environment).split()
    run(*compiler, *WARNINGS, *flags, "-lm", "-o", tmp_path / "evaluate", cwd=tmp_path)
    printed = run(
        tmp_path / "evaluate", tmp_path / "points.bin", env=os.environ | {"LD_LIBRARY_PATH": str(c_kernels / "lib")}
    )
    cells, points, displacement = square_in_a_square()
    moved = np.fromfile(tmp_path / "points.bin").reshape(-1, 2)
    np.testing.assert_allclose(moved, points + displacement, atol=1e-12)  # the solvers' rounding
    arrays = judged(moved, cells, cells_at_rest(points, cells), "size-skew")
    rows, numbers, bad, _ = kernels.judged_cells(*arrays, 3, 0.0)
    low, mean, _, _, median = rows[2]
    values = cell_quality(moved, cells, cells_at_rest(points, cells)).metric("size-skew")[numbers]
    assert printed.splitlines() == [
        f"size-skew of {len(cells)} cells: minimum {low:.6f}, mean {mean:.6f}, median {median:.6f}, {bad} inverted",
        *(f"cell {number}: {value:.6f}" for number, value in zip(numbers, values, strict=True)),
    ]


@pytest.mark.parametrize("compiler", [["gcc", "-std=c11", "-xc"], ["g++", "-std=c++11", "-xc++"]], ids=["c", "c++"])
def test_the_header_is_free_of_warnings(compiler: list[str]) -> None:
    need(compiler[0])
    run(*compiler, *WARNINGS, "-fsyntax-only", SOURCE / "include" / "mesh_motion_kernels.h")


def test_the_library_exports_exactly_the_declared_functions(c_kernels: Path) -> None:
    need("nm", "objdump")
    shared = c_kernels / "lib" / "libmesh_motion_kernels.so"
    names = set(re.findall(r" T (\w+)", run("nm", "-D", "--defined-only", shared)))
    header = (c_kernels / "include" / "mesh_motion_kernels.h").read_text()
    assert names == set(re.findall(r"MESH_MOTION_API [^;]*?\b(mesh_motion_\w+)\(", header))
    assert re.search(r"SONAME\s+libmesh_motion_kernels\.so\.1\n", run("objdump", "-p", shared))
    module = (c_kernels / "include" / "mesh_motion_kernels.f90").read_text()
    assert names - set(re.findall(r"\b(?:function|subroutine) (mesh_motion_\w+)\(", module)) == set()
