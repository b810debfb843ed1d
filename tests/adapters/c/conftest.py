"""The C client and programs with it, compiled in temporary folders; a real server; the Python client's results."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from mesh_motion_client import Mesh, Patch, connect
from programs import need

from tests.faults.server_process import ServerProcess

ROOT = Path(__file__).resolve().parents[3]
SOURCE = ROOT / "adapters" / "c"
CLIENT = sorted((SOURCE / "src").glob("*.c"))
HERE = Path(__file__).parent
WARNINGS = ["-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror"]
SANITIZE = ["-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
STANDARD = {".c": ["-std=c11"], ".cpp": ["-std=c++17"], ".f90": ["-std=f2008"]}
COMPILERS = {".c": "gcc", ".cpp": "g++", ".f90": "gfortran"}
PATIENCE = 120.0


def run(command, patience=PATIENCE, **options):
    done = subprocess.run(
        [*map(str, command)], capture_output=True, text=True, check=False, timeout=patience, **options
    )
    assert done.returncode == 0, f"{command}\n{done.stdout[-3000:]}\n{done.stderr[-3000:]}"
    return done.stdout


def compiled(command, **options):
    """The same for a compiler: its time depends on the machine, and the test has a limit."""
    return run(command, patience=None, **options)


@pytest.fixture(scope="session")
def zmq_flags():
    need("pkg-config")
    found = subprocess.run(["pkg-config", "--cflags", "--libs", "libzmq"], capture_output=True, text=True, check=False)
    if found.returncode:
        pytest.skip("the headers of libzmq are not installed (Debian: libzmq3-dev)")
    return found.stdout.split()


def seeded(folder, *faults):
    """The client's sources with each ``(sound, faulty)`` text replaced; every sound text occurs exactly once."""
    texts = {source: source.read_text() for source in CLIENT}
    for sound, faulty in faults:
        (place,) = [source for source, text in texts.items() for _ in range(text.count(sound))]
        texts[place] = texts[place].replace(sound, faulty)
        (folder / place.name).write_text(texts[place])
    return [changed if (changed := folder / source.name).exists() else source for source in CLIENT]


class Compiler:
    """Compiles programs against the sources of the client, with the sanitizers."""

    def __init__(self, folder, zmq_flags):
        self.folder, self.zmq_flags, self.objects = folder, zmq_flags, {}

    def object(self, source, flags=()):
        """Compile an object file; each file only once."""
        key = source, tuple(flags)
        if key not in self.objects:
            need(COMPILERS[source.suffix])
            made = self.folder / f"{len(self.objects)}_{source.stem}.o"
            includes = ["-I", SOURCE / "include", "-I", SOURCE / "src", f"-J{self.folder}"]
            if source.suffix != ".f90":
                includes.pop()
            # programs that decode hundreds of thousands of mutations must run fast, all others must compile fast
            speed = "-O1" if "wire" in source.stem else "-O0"
            given = [*STANDARD[source.suffix], *WARNINGS, *SANITIZE, speed, *flags, *includes]
            compiled([COMPILERS[source.suffix], *given, "-c", source, "-o", made])
            self.objects[key] = made
        return self.objects[key]

    def program(self, *sources, client=CLIENT):
        objects = [self.object(Path(source)) for source in (*client, *sources)]
        made = self.folder / f"{len(self.objects)}_{Path(sources[-1]).stem}"
        if not made.exists():
            compiler = COMPILERS[Path(sources[-1]).suffix]
            compiled([compiler, *SANITIZE, *objects, *self.zmq_flags, "-lm", "-o", made])
        return made


@pytest.fixture(scope="session")
def compiler(tmp_path_factory, zmq_flags):
    need("gcc")
    return Compiler(tmp_path_factory.mktemp("compiled"), zmq_flags)


@pytest.fixture(scope="session")
def installed(tmp_path_factory, zmq_flags):
    """The prefix into which CMake has installed everything, with the Fortran module if there is a compiler."""
    need("cmake", "gcc")
    folder = tmp_path_factory.mktemp("cmake")
    fortran = "ON" if shutil.which("gfortran") else "OFF"
    strict = "-DCMAKE_C_FLAGS=-Werror"
    prefix = folder / "prefix"
    compiled(["cmake", "-S", SOURCE, "-B", folder / "build", strict, f"-DMESH_MOTION_FORTRAN={fortran}",
         f"-DCMAKE_INSTALL_PREFIX={prefix}", "-DCMAKE_INSTALL_LIBDIR=lib"])  # fmt: skip
    compiled(["cmake", "--build", folder / "build"])
    compiled(["cmake", "--install", folder / "build"])
    return prefix


@pytest.fixture(scope="session")
def endpoint(tmp_path_factory):
    with ServerProcess(tmp_path_factory.mktemp("server"), level="error") as server:
        yield server.endpoint


CELLS, LOW, HIGH, STEPS, ITERATIONS = 16, 6, 10, 4, 3


def block_mesh():
    """The mesh of the example programs: a square of quadrilaterals around a block."""
    j, i = np.divmod(np.arange((CELLS + 1) ** 2), CELLS + 1)
    inside = (i > LOW) & (i < HIGH) & (j > LOW) & (j < HIGH)
    number = np.where(inside, -1, np.cumsum(~inside) - 1).reshape(CELLS + 1, CELLS + 1)
    i, j = i[~inside], j[~inside]
    hole = np.zeros((CELLS, CELLS), dtype=bool)
    hole[LOW:HIGH, LOW:HIGH] = True
    quads = np.stack([number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]], axis=-1)[~hole]
    block = np.flatnonzero((i >= LOW) & (i <= HIGH) & (j >= LOW) & (j <= HIGH))
    walls = np.flatnonzero((i == 0) | (i == CELLS) | (j == 0) | (j == CELLS))
    sides = {"block": Patch("moving", block), "walls": Patch("fixed", walls)}
    return Mesh(np.stack([i, j], axis=1) / CELLS, {"quad": quads}, sides)


@pytest.fixture(scope="session")
def python_answer(endpoint):
    """Expected output and files of the example programs, from the Python client."""
    mesh, qualities = block_mesh(), []
    with connect(endpoint) as server, server.open(mesh, {"support_radius": 0.5}) as session:
        x, y = (mesh.points[session.moving_nodes] - 0.5).T
        for step in range(STEPS):
            for iteration in range(1, ITERATIONS + 1):
                share = (step + iteration / ITERATIONS) / STEPS
                turned = np.stack([-0.04 * x - 0.28 * y + 0.1, 0.28 * x - 0.04 * y + 0.05], axis=1)
                session.move(share * turned, frame="reference")
            qualities.append(session.commit().quality["metric"]["min"])
        points = session.points()
        session.close("discard")
    lines = [f"step {step}: quality at least {quality:.6f}" for step, quality in enumerate(qualities, start=1)]
    return [*lines, f"minimum quality {min(qualities):.6f}"], points


@pytest.fixture
def check_example(endpoint, python_answer, tmp_path):
    def check(*command, **options):
        lines, points = python_answer
        printed = run([*command, endpoint, tmp_path / "points.bin"], **options)
        assert [line.strip() for line in printed.splitlines()] == lines
        np.testing.assert_array_equal(np.fromfile(tmp_path / "points.bin").reshape(-1, 2), points)

    return check


@pytest.fixture(scope="session")
def tools():
    """``run``, ``compile``, ``need``, ``seeded`` and the paths of the sources, for tests in addition to fixtures."""
    given = {"run": run, "compile": compiled, "need": need, "seeded": seeded}
    return given | {"client": CLIENT, "source": SOURCE, "here": HERE, "root": ROOT}
