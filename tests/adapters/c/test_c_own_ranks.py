"""The C client moves and judges the volume: bitwise as a server with the whole mesh."""

import ctypes
import os
import shutil
import signal
from concurrent.futures import ThreadPoolExecutor
from ctypes import byref, c_char_p, c_double, c_int, c_int64, c_size_t, c_void_p
from itertools import product

import numpy as np
import pytest
from far_meshes import far_block
from frame_meshes import tensor_grid, without_unused
from layered_grids import beyond_the_wall, grid, pitched
from mesh_motion_client import Credentials, Mesh, Patch, connect
from own_ranks import CORRECTED, SETTINGS, as_client, bend, in_pieces, on_ranks
from own_ranks import whole as box
from periodic_meshes import periodic_box, sector
from sliding_meshes import duct

from tests.faults.server_process import ServerProcess

pytestmark = pytest.mark.nightly

SINCE_REFERENCE, SINCE_COMMITTED, KEEP = 1, 0, 0


@pytest.fixture(scope="module")
def prefix(tmp_path_factory, tools, zmq_flags, c_kernels):
    """The prefix with the client that evaluates with the kernels."""
    folder, run = tmp_path_factory.mktemp("own_ranks"), tools["compile"]
    made, build = folder / "prefix", folder / "build"
    shutil.copytree(c_kernels, made, symlinks=True)  # the client looks for them where it is itself
    options = [f"-DCMAKE_INSTALL_PREFIX={made}", "-DCMAKE_INSTALL_LIBDIR=lib", "-DMESH_MOTION_EVALUATION=ON"]
    environment = os.environ | {"PKG_CONFIG_PATH": str(c_kernels / "lib" / "pkgconfig")}
    run(["cmake", "-S", tools["source"], "-B", build, *options, "-DCMAKE_C_FLAGS=-Werror"], env=environment)
    run(["cmake", "--build", build, "-j", str(os.cpu_count())])
    run(["cmake", "--install", build])
    return made


# --- MPI --------------------------------------------------------------------------------------------------------------


def cube(side):
    low, high = side * 5 // 12, side * 7 // 12
    points, cells = tensor_grid(*[np.arange(side + 1)] * 3)
    middle = points[cells].mean(axis=1)
    cells = cells[~((low < middle) & (middle < high)).all(axis=1)]
    ids, (at, cells) = np.unique(cells), without_unused(points, cells)
    sides = {
        "body": Patch("moving", np.flatnonzero(((low <= at) & (at <= high)).all(axis=1))),
        "wall": Patch("fixed", np.flatnonzero(((at == 0) | (at == side)).any(axis=1))),
    }
    return Mesh(at / side, {"hexahedron": cells}, sides), ids


@pytest.fixture(scope="module")
def whole(endpoint):
    """Side → numbers of nodes, their final coordinates, quality of each step, from a session with the whole mesh."""

    def answer(side, threshold):
        mesh, ids = cube(side)
        qualities, settings = [], CORRECTED | {"quality_threshold": threshold} if threshold else SETTINGS
        with connect(endpoint) as server, server.open(mesh, settings) as session:
            x, y, z = mesh.points[session.moving_nodes].T
            for step in (1, 2, 3):
                size = (0.2 if threshold else 0.02) * step
                moved = session.move(size * np.stack([y - 0.5, 0.5 - x, x * z], axis=1))
                quality = moved.quality["corrected"]
                values = [quality["size_skew"][name] for name in ("min", "p50")]
                qualities.append((quality["cells"], *values, moved.correction["freed_nodes"]))
                session.commit()
            return ids, session.points(), qualities

    known = {}
    return lambda *case: known[case] if case in known else known.setdefault(case, answer(*case))


@pytest.mark.parametrize(("side", "threshold", "ranks"), [(30, 0.0, 2), (12, 0.6, 4), (30, 0.6, 1)])
def test_ranks_of_mpi_give_what_the_whole_mesh_gives(prefix, endpoint, whole, tools, tmp_path, side, threshold, ranks):
    tools["need"]("mpicc", "mpiexec")
    program, source = tmp_path / "own_ranks", tools["source"] / "examples" / "own_ranks.c"
    flags = ["-std=c11", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-O1"]
    places = [f"-I{prefix}/include", f"-L{prefix}/lib", f"-Wl,-rpath,{prefix}/lib", "-lmesh_motion"]
    tools["compile"](["mpicc", *flags, source, *places, "-o", program])
    everywhere = ["--oversubscribe", *(["--allow-run-as-root"] if os.geteuid() == 0 else [])]
    printed = tools["run"](
        ["mpiexec", *everywhere, "-n", ranks, program, endpoint, side, tmp_path / "points", threshold]
    )
    ids, points, qualities = whole(side, threshold)
    lines = [
        f"step {step}: {cells} cells, minimum {low:.17g}, median {middle:.17g}; {freed} nodes freed"
        for step, (cells, low, middle, freed) in enumerate(qualities, 1)
    ]
    assert [
        line.partition(" freed,")[0] + " freed" for line in printed.splitlines() if line.startswith("step")
    ] == lines
    assert bool(qualities[-1][-1]) == bool(threshold)
    for rank in range(ranks):
        raw = (tmp_path / f"points.{rank}").read_bytes()
        numbers = np.frombuffer(raw, np.int64, np.frombuffer(raw, np.int64, 1)[0], 8)
        found = np.frombuffer(raw, np.float64, -1, 8 + 8 * len(numbers)).reshape(-1, 3)
        np.testing.assert_array_equal(found, points[np.searchsorted(ids, numbers)])


# --- one rank, from Python --------------------------------------------------------------------------------------------


class CSession:
    """A session of the C library; arrays are kept while the library may read them."""

    def __init__(self, prefix, endpoint):
        self.c = ctypes.CDLL(str(prefix / "lib" / "libmesh_motion.so"))
        for name in ("mm_context_new", "mm_session_new", "mm_moved", "mm_token"):
            getattr(self.c, name).restype = c_void_p
        for name in ("mm_error_code", "mm_error_message", "mm_id"):
            getattr(self.c, name).restype = c_char_p
        self.c.mm_report_number.restype = c_double
        self.server = c_void_p(self.c.mm_context_new())
        self.call("connect", endpoint.encode(), of=self.server)
        self.session = c_void_p(self.c.mm_session_new(self.server))

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.c.mm_context_free(self.server)

    def call(self, name, *given, of=None):
        result = getattr(self.c, f"mm_{name}")(of or self.session, *given)
        if result:
            code, message = (one(self.server).decode() for one in (self.c.mm_error_code, self.c.mm_error_message))
            self.c.mm_clear_error(self.server)
            raise RuntimeError(f"{code}: {message}")

    def describe(self, mesh):
        if mesh.global_ids is not None:
            mesh = Mesh(mesh.points, mesh.cells, mesh.patches, np.ascontiguousarray(mesh.global_ids, dtype=np.int64))
        self.mesh = mesh  # its arrays are read until the mesh is built
        n, d = mesh.points.shape
        self.call("points", c_int(d), c_size_t(n), at(mesh.points))
        for kind, cells in mesh.cells.items():
            self.call("cells32" if cells.dtype == np.int32 else "cells", kind.encode(), c_size_t(len(cells)), at(cells))
        for name, patch in mesh.patches.items():
            self.call("patch", name.encode(), patch.role.encode(), c_size_t(len(patch.nodes)), at(patch.nodes))
        if mesh.global_ids is not None:
            self.call("global_ids", at(mesh.global_ids))

    def open(self, mesh, settings, evaluation="client"):
        self.describe(mesh)
        self.call("set_evaluation", evaluation.encode())
        for key, value in settings.items():
            if isinstance(value, bool):
                self.call("set_flag", key.encode(), c_int(value))
            elif isinstance(value, float):
                self.call("set_number", key.encode(), c_double(value))
            else:
                self.call("set_text", key.encode(), value.encode())
        self.call("open")
        self.call("build")

    @property
    def credentials(self):
        token = ctypes.string_at(c_void_p(self.c.mm_token(self.session)), 32)
        return Credentials(self.c.mm_id(self.session).decode(), token)

    def resume(self, credentials):
        self.call("set_credentials", credentials.session.encode(), credentials.token)
        self.call("resume")

    @property
    def moving_nodes(self):
        count = c_size_t()
        self.c.mm_moving_nodes.restype = ctypes.POINTER(c_int64)
        found = self.c.mm_moving_nodes(self.session, byref(count))
        return np.array(found[: count.value], dtype=np.int64)

    def move(self, displacement, frame=SINCE_REFERENCE):
        rows, found = np.ascontiguousarray(displacement), np.full_like(self.mesh.points, np.nan)
        self.call("move", c_int(frame), c_size_t(len(rows)), at(rows), c_size_t(len(found)), at(found))
        return found

    def tangent(self, velocity):
        """(n, c d) of velocities (k, c d)."""
        return self.differentiated("tangent", velocity, len(self.mesh.points))

    def cotangent(self, weights):
        """(k, c d) of weights (n, c d)."""
        return self.differentiated("cotangent", weights, len(self.moving_nodes))

    def differentiated(self, which, given, rows):
        given, vectors = np.ascontiguousarray(given), given.shape[1] // self.mesh.points.shape[1]
        found = np.full((rows, given.shape[1]), np.nan)
        self.call(which, c_size_t(vectors), c_size_t(len(given)), at(given), c_size_t(rows), at(found))
        return found

    def points(self):
        found = np.full_like(self.mesh.points, np.nan)
        self.call("fetch", c_int(SINCE_COMMITTED), c_size_t(len(found)), at(found))
        return found

    def quality(self, path):
        return self.c.mm_report_number(c_void_p(self.c.mm_moved(self.session)), f"quality.corrected.{path}".encode())


def at(array):
    assert array.flags.c_contiguous
    return array.ctypes.data_as(c_void_p)


#: Numbers of a report; means are sums in another order.
NUMBERS = [(name, value) for name in ("size", "skew", "size_skew", "metric") for value in ("min", "p1", "p5", "p50")]


@pytest.mark.parametrize(
    ("kind", "count", "settings"),
    [
        ("quad", 20, {}),
        ("quad + triangle", 20, {"basis": "tps"}),
        ("quad", 240, {"quality_metric": "size-skew-root"}),
        ("tetra", 12, {}),
        ("hexahedron", 20, {"quality_metric": "skew"}),
    ],
)
def test_one_rank_gives_what_a_session_with_the_whole_mesh_gives(prefix, endpoint, kind, count, settings):
    mesh, settings = box(kind, count), SETTINGS | settings
    with connect(endpoint) as server, server.open(mesh, settings) as expected, CSession(prefix, endpoint) as session:
        session.open(mesh, settings)
        np.testing.assert_array_equal(session.moving_nodes, expected.moving_nodes)
        np.testing.assert_array_equal(session.points(), mesh.points)
        body = mesh.points[expected.moving_nodes]
        for step in (1, 2):
            for share in (0.5, 1.0):
                moved = expected.move(share * bend(body, step))
                np.testing.assert_array_equal(session.move(share * bend(body, step)), moved.displacement)
                known = moved.quality["corrected"]  # of a step's later move the minimum and the worst cells
                assert ("size" in known) == (share == 0.5)
                for name, value in NUMBERS if share == 0.5 else [("metric", "min")]:
                    assert session.quality(f"{name}.{value}") == known[name][value]
                assert session.quality("inverted") == moved.quality["corrected"]["inverted"]
                worst = [cell["metric"] for cell in moved.quality["corrected"]["worst"]]
                assert [session.quality(f"worst.{i}.metric") for i in range(len(worst))] == worst
            expected.commit()
            session.call("commit")
        np.testing.assert_array_equal(session.points(), expected.points())
        with pytest.raises(RuntimeError, match="expected frame 'reference'"):
            session.move(bend(body, 1), frame=SINCE_COMMITTED)


@pytest.mark.parametrize(
    ("kind", "count", "settings", "steps"),
    [
        ("tetra", 12, {}, (10, 14)),
        ("quad + triangle", 20, {}, (10, 14)),
        ("quad + triangle", 20, CORRECTED, (16, 20)),
        ("quad", 240, CORRECTED, (16, 20)),
        ("hexahedron", 20, CORRECTED | {"quality_metric": "relative-size-skew"}, (16, 20)),
    ],
)
def test_one_rank_is_corrected_as_by_python_and_as_a_session_with_the_whole_mesh(
    prefix, endpoint, kind, count, settings, steps
):
    """By the smooth correction as a rank of Python, by the other one as the server, which has the whole mesh."""
    mesh, evaluation = box(kind, count), "server" if settings else "client"
    with (
        connect(endpoint) as server,
        server.open(mesh, settings, evaluation=evaluation) as expected,
        CSession(prefix, endpoint) as session,
    ):
        session.open(mesh, settings)
        most = 0
        for step in steps:
            boundary = bend(mesh.points[expected.moving_nodes], step)
            moved = expected.move(boundary)
            np.testing.assert_array_equal(session.move(boundary), moved.displacement)
            report = c_void_p(session.c.mm_moved(session.session))
            freed = session.c.mm_report_integer(report, b"correction.freed_nodes", 0)
            assert freed == moved.correction["freed_nodes"]
            most = max(most, freed)
            assert session.quality("metric.min") == pytest.approx(
                moved.quality["corrected"]["metric"]["min"], rel=1e-12
            )
            expected.commit()
            session.call("commit")
            np.testing.assert_array_equal(session.points(), expected.points())
        assert most > 0


@pytest.mark.parametrize(("settings", "by"), [(SETTINGS, 1), (CORRECTED, 10)], ids=["plain", "corrected"])
def test_after_kill_9_the_trial_is_made_and_judged_again(prefix, tmp_path, settings, by):
    mesh = box("hexahedron", 20)
    with ServerProcess(tmp_path) as server, CSession(prefix, server.endpoint) as session:
        session.open(mesh, settings)
        body = mesh.points[session.moving_nodes]
        session.move(bend(body, by))
        session.call("commit")
        found = session.move(bend(body, 2 * by))
        server.stop(signal.SIGKILL)
        server.start()
        session.call("commit")
        np.testing.assert_array_equal(session.points(), mesh.points + found)
        server.stop(signal.SIGKILL)
        server.start()
        np.testing.assert_array_equal(session.move(bend(body, by)), session.move(bend(body, by)))
        with CSession(prefix, server.endpoint) as other:
            token = ctypes.string_at(c_void_p(session.c.mm_token(session.session)), 32)
            other.call("set_credentials", c_char_p(session.c.mm_id(session.session)), token)
            with pytest.raises(RuntimeError, match="the mesh is not known here"):
                other.call("resume")
            moved = Mesh(mesh.points * 1.5, mesh.cells, mesh.patches)
            other.describe(moved)
            with pytest.raises(RuntimeError, match="not the one that this session was opened with"):
                other.call("resume")
            other.describe(mesh)
            other.call("resume")
            np.testing.assert_array_equal(other.points(), mesh.points + found)
            again = other.move(bend(body, by))
            other.call("commit")
            np.testing.assert_array_equal(other.points(), mesh.points + again)


def test_a_quality_that_is_refused_is_refused(prefix, endpoint):
    mesh, settings = box("quad", 20), SETTINGS | {"refuse_below_threshold": True, "quality_threshold": 0.9}
    with CSession(prefix, endpoint) as session:
        session.open(mesh, settings)
        body = mesh.points[session.moving_nodes]
        with pytest.raises(RuntimeError, match=r"FAILED_PRECONDITION\.QUALITY"):
            session.move(4.0 * bend(body, 3))
        with pytest.raises(RuntimeError, match=r"FAILED_PRECONDITION\.STATE"):
            session.call("commit")
        session.move(0.1 * bend(body, 3))
        session.call("commit")
        session.call("close", c_int(KEEP))


def test_a_cell_that_is_inverted_is_refused(prefix, endpoint):
    mesh = box("quad", 10)
    cells = mesh.cells["quad"].copy()
    cells[7] = cells[7][::-1]
    with CSession(prefix, endpoint) as session, pytest.raises(RuntimeError, match="got quad 7, which is inverted"):
        session.open(Mesh(mesh.points, {"quad": cells}, mesh.patches), SETTINGS)


# --- walls, and derivatives -------------------------------------------------------------------------------------------

WALLS = {
    "plane of two types": lambda: duct("quad + triangle", 20),
    "planes in space": lambda: duct("hexahedron", 10),
    "curved": lambda: duct("quad", 20, bend=1.2),
    "curved in space": lambda: duct("wedge", 10, bend=1.2),
    "periodic": lambda: periodic_box("quad", 20, shear=0.3),
    "sector": lambda: sector("quad", 20),
    "many in plane": lambda: duct("quad", 240),
    "far field": lambda: far_block("quad", 20),
}
#: Of the block: no cell resists the first, some do the others.
SMALL, LARGE = (0.01, 0.006, 0.004), (0.1, 0.2, 0.1)


def shifted(count, shift, mesh):
    return np.tile(shift[: mesh.points.shape[1]], (count, 1))


@pytest.mark.parametrize(("name", "settings"), [*((name, {}) for name in WALLS), ("curved", {"basis": "tps"})])
def test_nodes_slide_and_are_differentiated_as_by_python(prefix, endpoint, name, settings):
    """Equal motion bit by bit, equal derivatives except for the order of sums: for trials and committed states, two
    vectors at once.
    """
    mesh = as_client(*WALLS[name]())
    d = mesh.points.shape[1]
    with (
        connect(endpoint) as server,
        server.open(mesh, settings, evaluation="client") as expected,
        CSession(prefix, endpoint) as session,
    ):
        session.open(mesh, settings)
        moving = mesh.points[session.moving_nodes]
        k, v = len(moving), np.stack([np.sin(5.0 * moving), np.cos(3.0 * moving)])
        w = np.stack([np.cos(4.0 * mesh.points), np.sin(7.0 * mesh.points)])
        columns = [np.concatenate(list(given), axis=1) for given in (v, w)]

        def compare():
            velocity, weights = session.tangent(columns[0]), session.cotangent(columns[1])
            for one in range(2):
                of = slice(one * d, one * d + d)
                found, back = expected.tangent(v[one]), expected.cotangent(w[one])
                np.testing.assert_allclose(velocity[:, of], found, rtol=0.0, atol=1e-13 * np.abs(found).max())
                np.testing.assert_allclose(weights[:, of], back, rtol=0.0, atol=1e-7 * np.abs(back).max())
                size = np.linalg.norm(weights[:, of]) * np.linalg.norm(v[one])
                assert abs(np.sum(w[one] * velocity[:, of]) - np.sum(weights[:, of] * v[one])) <= 1e-12 * size

        compare()  # before any motion
        for shift, method in ((SMALL, "none"), (LARGE, "smooth")):
            moved = expected.move(shifted(k, shift, mesh))
            assert moved.correction["method"] == method
            np.testing.assert_array_equal(session.move(shifted(k, shift, mesh)), moved.displacement)
            compare()
            expected.commit()
            session.call("commit")
            compare()
        np.testing.assert_array_equal(session.points(), expected.points())


@pytest.mark.parametrize("name", ["curved", "planes in space", "sector"])
def test_a_rank_in_c_next_to_ranks_in_python(prefix, tmp_path, name):
    """The ranks move as three ranks of Python do, and their derivatives are equal to rounding."""
    mesh = as_client(*WALLS[name]())
    parts, weights = in_pieces(mesh, 3), np.cos(4.0 * mesh.points)

    def work(session, part):
        moving = session.moving_nodes
        moved = session.move(shifted(len(moving), LARGE, mesh))
        v, w = np.sin(5.0 * part.points[moving]), weights[part.global_ids]
        return getattr(moved, "displacement", moved), session.tangent(v), session.cotangent(w), moving

    with ServerProcess(tmp_path) as server:
        expected = on_ranks(server, parts, work, {})
        mixed = first_in_c(prefix, server, parts, work)
    assert any(len(moving) for *_, moving in expected)
    for (moved, velocity, back, moving), (there, velocities, rows, nodes) in zip(mixed, expected, strict=True):
        np.testing.assert_array_equal(moving, nodes)
        np.testing.assert_array_equal(moved, there)
        np.testing.assert_allclose(velocity, velocities, rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(back, rows, rtol=0.0, atol=1e-8 * np.abs(weights).sum())


def first_in_c(prefix, server, parts, work):
    """Run ``work(session, part)`` on ranks of which the first is in C, and all others are in Python."""
    with CSession(prefix, server.endpoint) as session, ThreadPoolExecutor(len(parts)) as pool:
        session.call("set_partition", c_int(0), c_int(len(parts)))
        session.describe(parts[0])
        session.call("set_evaluation", b"client")
        session.call("open")
        credentials = session.credentials

        def join(rank):
            with connect(server.endpoint) as client, client.join(credentials, parts[rank], partition=rank) as joined:
                return work(joined, parts[rank])

        others = [pool.submit(join, rank) for rank in range(1, len(parts))]
        session.call("build")
        return [work(session, parts[0]), *(other.result() for other in others)]


# --- layers of thin cells ---------------------------------------------------------------------------------------------


def pitch(session, part):
    """Displacements and points of two steps, with derivatives after each: equal for a session in C and in Python."""
    moving, found = session.moving_nodes, []
    for degrees in (1.0, 25.0):
        moved = session.move(pitched(part.points[moving], degrees))
        velocity = session.tangent(np.sin(5.0 * part.points[moving]))
        getattr(session, "commit", lambda: session.call("commit"))()
        found += [getattr(moved, "displacement", moved), session.points(), velocity]
    return found


def assert_same_pitch(found, there):
    """Nodes bitwise, velocities to rounding."""
    for number, (one, known) in enumerate(zip(found, there, strict=True)):
        np.testing.assert_allclose(one, known, rtol=0.0, atol=1e-12 if number % 3 == 2 else 0.0)


@pytest.mark.parametrize("kind", ["quads", "triangles", "wing"])
def test_layers_are_carried_as_by_python(prefix, endpoint, kind):
    mesh = grid(kind)
    with connect(endpoint) as server, server.open(mesh, evaluation="client") as expected:
        there = pitch(expected, mesh)
    with CSession(prefix, endpoint) as session:
        session.open(mesh, {})
        found = pitch(session, mesh)
        with CSession(prefix, endpoint) as other:
            other.describe(mesh)
            other.resume(session.credentials)
            np.testing.assert_array_equal(other.points(), found[-2])
    assert_same_pitch(found, there)


@pytest.mark.parametrize("first", ["at the wall", "beyond the wall"])
def test_layers_next_to_ranks_in_python(prefix, tmp_path, first):
    parts = beyond_the_wall(grid("quads"))[:: 1 if first == "at the wall" else -1]
    with ServerProcess(tmp_path) as server:
        expected = on_ranks(server, parts, pitch, {})
        mixed = first_in_c(prefix, server, parts, pitch)
    for found, there in zip(mixed, expected, strict=True):
        assert_same_pitch(found, there)


@pytest.mark.parametrize("name", ["derivatives.cpp", "derivatives.f90"])
def test_other_languages_differentiate_as_python(prefix, endpoint, tools, tmp_path, name):
    """A move that is corrected, two vectors at once: bitwise if the server evaluates them."""
    compiler, standard = ("gfortran", "f2008") if name.endswith(".f90") else ("g++", "c++17")
    tools["need"](compiler)
    module = [tools["source"] / "fortran" / "mesh_motion.f90"] * name.endswith(".f90")
    flags = [f"-std={standard}", "-Wall", "-Werror", f"-I{prefix}/include", f"-L{prefix}/lib", "-lmesh_motion"]
    sources = [*module, tools["here"] / name]
    tools["compile"]([compiler, *sources, *flags, f"-Wl,-rpath,{prefix}/lib", "-o", "program"], cwd=tmp_path)
    side = np.arange(13) / 12
    x, y = (each.ravel() for each in np.meshgrid(side, side))
    number = np.arange(13 * 13).reshape(13, 13)
    quads = np.stack([number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]], axis=-1).reshape(-1, 4)
    walls = np.flatnonzero((x > 0.0) & (x < 1.0) & ((y == 0.0) | (y == 1.0)))
    for role, evaluation in product(("fixed", "slip"), ("client", "server")):
        printed = tools["run"]([tmp_path / "program", endpoint, role, evaluation]).split()
        sides = {"left": Patch("moving", number[:, 0].copy()), "walls": Patch(role, walls)}
        sides["right"] = Patch("fixed", number[:, -1].copy())
        mesh = Mesh(np.stack([x, y], axis=1), {"quad": quads}, sides)
        with connect(endpoint) as server, server.open(mesh, evaluation=evaluation) as session:
            moved = session.move(np.stack([1.2 * side * (1.0 - side), 0.0 * side], axis=1))
            assert moved.correction["freed_nodes"]
            back = [session.cotangent(np.stack(w, axis=1)) for w in ((x, y), (x * y, x**0))]
            found = [session.tangent(np.stack(v, axis=1)) for v in ((side, side**0), (side**0, side * side))]
        expected = np.concatenate([np.concatenate(rows, axis=1).ravel() for rows in (found, back)])
        exact = 0.0 if evaluation == "server" else 1e-12 * np.abs(expected).max()
        np.testing.assert_allclose(np.array(printed, dtype=float), expected, rtol=0.0, atol=exact)


def test_after_kill_9_the_derivative_is_the_same(prefix, tmp_path):
    """The server has forgotten the region of the correction, and gets it again."""
    mesh = as_client(*WALLS["curved"]())
    with ServerProcess(tmp_path) as server, CSession(prefix, server.endpoint) as session:
        session.open(mesh, {})
        v, w = np.sin(5.0 * mesh.points[session.moving_nodes]), np.cos(5.0 * mesh.points)
        session.move(shifted(len(v), LARGE, mesh))
        session.call("commit")
        expected = session.tangent(v), session.cotangent(w)
        for which, given in ((0, v), (1, w)):
            server.stop(signal.SIGKILL)
            server.start()
            found = session.cotangent(given) if which else session.tangent(given)
            np.testing.assert_allclose(found, expected[which], rtol=0.0, atol=1e-12 * np.abs(expected[which]).max())
        points = session.points()
        with CSession(prefix, server.endpoint) as other:
            other.describe(mesh)
            other.resume(session.credentials)
            np.testing.assert_allclose(
                other.cotangent(w), expected[1], rtol=0.0, atol=1e-12 * np.abs(expected[1]).max()
            )
            np.testing.assert_array_equal(other.points(), points)


def test_weights_that_are_not_finite_are_refused(prefix, endpoint):
    mesh = box("quad", 10)
    weights = np.ones_like(mesh.points)
    weights[3, 1] = np.nan
    with CSession(prefix, endpoint) as session:
        session.open(mesh, {})
        with pytest.raises(RuntimeError, match=r"NONFINITE: weights must be finite, got -?nan in row 3"):
            session.cotangent(weights)


def test_a_library_without_the_kernels_says_so(installed, endpoint):
    with CSession(installed, endpoint) as session, pytest.raises(RuntimeError, match="UNIMPLEMENTED: this client was"):
        session.open(box("quad", 10), SETTINGS)
