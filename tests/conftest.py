"""Fixtures and options that all tests share."""

import gc
import logging
import os
import signal
import subprocess
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings
from made_once import made_once
from mesh_motion_client import Server, connect
from mesh_motion_numerics.blas import one_blas_thread
from programs import need

from mesh_motion_server import failpoints
from mesh_motion_server.transport.processes import repeatable_libraries
from tests.faults.failpoint_plan import PLAN
from tests.faults.waiting import PATIENCE

ROOT = Path(__file__).resolve().parents[1]

#: Number of examples that hypothesis draws for a test: `make test` uses the first, `make test-all` the second.
settings.register_profile("few", max_examples=25, deadline=None)
settings.register_profile("many", max_examples=100, deadline=None)
settings.load_profile("few")

# A shell that starts the tests in the background lets them ignore Ctrl-C, and so would every process that they start.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


#: Fixtures that compile. On a busy machine this takes many minutes, and the first test that needs one waits for it.
_COMPILE = {"foam_environment", "flap", "tools", "zmq_flags", "c_kernels", "sdist", "wheel"}

#: A nightly test takes as long as so many others.
_NIGHTLY_WEIGHT = 25


@pytest.hookimpl(tryfirst=True)  # before -m selects tests
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Run rows of `make prove` only on request.

    Without slow tests there are no nightly ones either. A test whose fixture compiles gets one time limit, which
    includes the compilation. Next to others, files with many minutes come first, so that no process ends long before
    the last one.
    """
    if "faults" not in config.option.markexpr:
        config.hook.pytest_deselected(items=[item for item in items if item.get_closest_marker("faults")])
        items[:] = [item for item in items if not item.get_closest_marker("faults")]
    for item in items:
        if item.get_closest_marker("nightly"):
            item.add_marker("slow")
        if _COMPILE.intersection(getattr(item, "fixturenames", ())):
            item.add_marker(pytest.mark.timeout(1800), append=False)
    if "PYTEST_XDIST_WORKER" in os.environ:
        weights: Counter[Path] = Counter()
        for item in items:
            weights[item.path] += _NIGHTLY_WEIGHT if item.get_closest_marker("nightly") else 1
        items.sort(key=lambda item: -weights[item.path])


@pytest.fixture(scope="session", autouse=True)
def one_thread_of_blas() -> Iterator[None]:
    """Compute as servers do. OpenBLAS' threads spin while they wait: next to other tests that is most of the time."""
    with one_blas_thread():
        yield


@pytest.fixture(autouse=True)
def broken_pipes_are_errors() -> Iterator[None]:
    """Make broken pipes errors again, as in Python: Gmsh sets the process to end at a broken pipe."""
    yield
    signal.signal(signal.SIGPIPE, signal.SIG_IGN)


@pytest.fixture(scope="module", autouse=True)
def nothing_left_open() -> Iterator[None]:
    """Collect garbage, so that a module that leaves a socket or file open fails, and not a later module."""
    yield
    gc.collect()


@pytest.fixture(autouse=True)
def logs_of_their_own() -> Iterator[None]:
    """Undo a test's logging setup: its level, and handlers that write to its captured and closed standard error."""
    root = logging.getLogger()
    before, level = list(root.handlers), root.level
    yield
    root.setLevel(level)
    for handler in [handler for handler in root.handlers if handler not in before]:
        root.removeHandler(handler)


_CODE_OF_LIBRARIES = tuple(repeatable_libraries())


@pytest.fixture(autouse=True)
def libraries_of_their_own() -> Iterator[None]:
    """Undo the choice of library code that `serve` makes in this process for its children."""
    before = {name: os.environ[name] for name in _CODE_OF_LIBRARIES if name in os.environ}
    yield
    for name in set(_CODE_OF_LIBRARIES) - set(before):
        os.environ.pop(name, None)
    os.environ.update(before)


@pytest.fixture(scope="session")
def server() -> Iterator[Server]:
    with connect() as server:
        yield server


@pytest.fixture(scope="session")
def c_kernels(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the kernels installed as a C library; compiled once for all processes that run tests."""
    need("cmake", "g++")

    def make(folder: Path) -> None:
        options = ["-DMESH_MOTION_PYTHON=OFF", "-DMESH_MOTION_C=ON", "-DCMAKE_INSTALL_LIBDIR=lib"]
        build = folder / "build"
        for arguments in (
            ["-S", ROOT / "numerics/kernels", "-B", build, f"-DCMAKE_INSTALL_PREFIX={folder / 'prefix'}", *options],
            ["--build", build, "-j", str(os.cpu_count())],
            ["--install", build],
        ):
            done = subprocess.run(["cmake", *arguments], capture_output=True, text=True, check=False)
            assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]

    return made_once(tmp_path_factory, "c_kernels", make) / "prefix"


@pytest.fixture
def background() -> Iterator[Callable[[Callable[[], Any]], Callable[[], Any]]]:
    """Run a call in a thread; the function that is returned gives its result, or raises its error."""
    pool = ThreadPoolExecutor()
    yield lambda call: partial(pool.submit(call).result, PATIENCE)
    pool.shutdown()


@pytest.fixture
def plan_fault(tmp_path: Path) -> Iterator[Callable[[str], None]]:
    """Make a fault happen in this process, in the words of a plan of failpoints: ``store.list=raise:EIO@1``."""
    folder = tmp_path / "failpoints"
    folder.mkdir(mode=0o700)
    failpoints.activate({failpoints.VARIABLE: str(folder)})

    def plan(text: str) -> None:
        (folder / "next").write_text(text)
        (folder / "next").replace(folder / PLAN)

    yield plan
    failpoints.deactivate()
