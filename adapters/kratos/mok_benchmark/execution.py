"""A run from outside: what it needs in its folder, the server, Kratos' process, its progress, its time."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mesh_motion_client.embedded import EmbeddedServer
from numpy.typing import NDArray

from mok_benchmark import parameters
from mok_benchmark.benchmark import FLUID_DENSITY, POINTS, TIME_STEP, VISCOSITY
from mok_benchmark.meshes import FluidMesh, fluid_mesh, write_fluid, write_wall

__all__ = ["History", "RunFailed", "Size", "kratos_python", "missing_kratos", "prepare", "run"]

_ROOT = Path(__file__).resolve().parents[3]
_SOURCES = ("protocol", "adapters/python", "adapters/kratos")
_APPLICATIONS = ("MeshMoving", "LinearSolvers", "FluidDynamics", "StructuralMechanics", "CoSimulation", "Mapping")


class RunFailed(Exception):
    """Kratos did not come to its end; the message has its last words."""


@dataclass(frozen=True)
class Size:
    """How fine a computation is.

    Attributes
    ----------
    wall_elements : int
        Quadratic elements on top of each other.
    coarsest : float
        Edge length of the fluid's triangles far from the wall, m.
    end_time : float
        s.
    """

    wall_elements: int
    coarsest: float
    end_time: float


@dataclass(frozen=True)
class History:
    """What a run left.

    Attributes
    ----------
    times : (k,) array, s
    displacements : (k, p, 2) array, m
        Of the reference points, in the order of ``benchmark.POINTS``.
    points : (k, n, 2) array, m
        The fluid's mesh after each step.
    iterations : (k,) int array
        Coupling iterations of each step.
    mesh_seconds, seconds : (k,) arrays
        Of the mesh solver, and of the whole, in each step.
    cpu_seconds : float
        Of all processes together, from their start to their end.
    """

    times: NDArray[np.float64]
    displacements: NDArray[np.float64]
    points: NDArray[np.float64]
    iterations: NDArray[np.int64]
    mesh_seconds: NDArray[np.float64]
    seconds: NDArray[np.float64]
    cpu_seconds: float


def kratos_python() -> str:
    """The interpreter with Kratos: $KRATOS_PYTHON, else the one of ``environment.sh``, else this one."""
    cache = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache"))
    made = cache / "mesh-motion" / "kratos-10.4" / "bin" / "python"
    return os.environ.get("KRATOS_PYTHON") or (str(made) if made.exists() else sys.executable)


def missing_kratos() -> str:
    """Why the benchmark cannot run with :func:`kratos_python`, and how it can; empty if it can."""
    imports = ["zmq", "msgpack", "numpy", *(f"KratosMultiphysics.{name}Application" for name in _APPLICATIONS)]
    python = kratos_python()
    try:
        done = subprocess.run(
            [python, "-c", f"import {', '.join(imports)}"], capture_output=True, text=True, check=False
        )
    except OSError as error:
        return f"{python} cannot be run: {error.strerror}; KRATOS_PYTHON must name a Python interpreter"
    if done.returncode == 0:
        return ""
    said = (done.stderr.strip().splitlines() or ["it ended without a word"])[-1]
    return (
        f"Kratos is not installed for {python}: {said}\n"
        "adapters/kratos/environment.sh makes an environment with it (69 MB), which is then found; "
        "KRATOS_PYTHON names another interpreter"
    )


def prepare(folder: Path, size: Size) -> FluidMesh:
    """Write meshes and material into the folder; the fluid's mesh."""
    folder.mkdir(parents=True, exist_ok=True)
    mesh = fluid_mesh(2 * size.wall_elements, size.coarsest)
    write_fluid(folder / "fluid.mdpa", mesh, {"DENSITY": FLUID_DENSITY, "DYNAMIC_VISCOSITY": VISCOSITY})
    wall = write_wall(folder / "wall.mdpa", size.wall_elements)
    nodes = [1 + int(np.argmin(((wall - point) ** 2).sum(axis=1))) for point in POINTS.values()]
    (folder / "nodes.json").write_text(json.dumps(nodes))
    (folder / "materials.json").write_text(json.dumps(parameters.materials()))
    return mesh


def run(folder: Path, mesh_solver: str, size: Size, progress: Callable[[int, int], None]) -> History:
    """Compute with one of ``parameters.MESH_SOLVERS``.

    Parameters
    ----------
    folder : Path
        As :func:`prepare` left it.
    mesh_solver : str
    size : Size
    progress : callable
        Takes the time steps done and their number.

    Raises
    ------
    RunFailed
    """
    settings = parameters.MESH_SOLVERS[mesh_solver]
    end = size.end_time - TIME_STEP / 2.0  # so that round-off adds no step
    (folder / "coupling.json").write_text(json.dumps(parameters.coupling(settings, end), indent=1))
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with _server("remote" in settings) as endpoint:
        _kratos(folder, endpoint, progress)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return History(**np.load(folder / "history.npz"), cpu_seconds=cpu)


@contextmanager
def _server(wanted: bool) -> Iterator[str]:
    """A private server's endpoint, empty if none is wanted."""
    server = EmbeddedServer(None, 300.0, ["--threads", "1"]) if wanted else None
    try:
        yield server.endpoint if server else ""
    finally:
        if server:
            server.stop()


def _kratos(folder: Path, endpoint: str, progress: Callable[[int, int], None]) -> None:
    """Run Kratos' process to its end; one thread, as the server has."""
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join(str(_ROOT / source) for source in _SOURCES),
        "OMP_NUM_THREADS": "1",
        "MESH_MOTION_ENDPOINT": endpoint,
    }
    log = folder / "kratos.log"
    with log.open("w") as errors:
        process = subprocess.Popen(
            [kratos_python(), "-m", "mok_benchmark.kratos_run"], cwd=folder, env=environment,
            stdout=subprocess.PIPE, stderr=errors, text=True,
        )  # fmt: skip
        with process:
            for line in process.stdout or ():
                errors.write(line)
                words = line.split()
                if words[:1] == ["step"] and words[2:3] == ["of"]:
                    progress(int(words[1]), int(words[3]))
    if process.returncode:
        last = " | ".join(log.read_text().strip().splitlines()[-3:])
        raise RunFailed(f"Kratos ended with status {process.returncode}: {last} (all of it: {log})")
