"""Start and watch a run: its folder's files, the server, Kratos' process, its progress, its time."""

from __future__ import annotations

import json
import os
import resource
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mesh_motion_client.embedded import EmbeddedServer
from numpy.typing import NDArray

from mok_benchmark import parameters
from mok_benchmark.benchmark import CASE, FLUID_DENSITY, POINTS, POISSON, SOLID_DENSITY, VISCOSITY, YOUNG
from mok_benchmark.meshes import FluidMesh, channel_mesh, wall_lattice, write_fluid, write_solid

__all__ = ["History", "RunFailed", "Size", "compute", "kratos_python", "missing_kratos", "prepare", "run", "watch"]

_ROOT = Path(__file__).resolve().parents[3]
_SOURCES = ("adapters/python", "adapters/kratos")
_APPLICATIONS = ("MeshMoving", "LinearSolvers", "FluidDynamics", "StructuralMechanics", "CoSimulation", "Mapping")


class RunFailed(Exception):
    """Kratos failed before its end; the message has its last lines of output."""


@dataclass(frozen=True)
class Size:
    """How fine a computation is.

    Attributes
    ----------
    wall : (3,) tuple of int
        Rows and columns of the wall's elements, and their order.
    coarsest : float
        Edge length of the fluid's triangles far from the wall, m.
    end_time : float
        s.
    """

    wall: tuple[int, int, int]
    coarsest: float
    end_time: float


@dataclass(frozen=True)
class History:
    """The results of a run.

    Attributes
    ----------
    times : (k,) array, s
    displacements : (k, p, 2) array, m
        Of the reference points, in the order of ``benchmark.POINTS``.
    forces : (k, 2) array, N/m
        Of the flow, on the parts that are watched.
    points : (k, n, 2) array, m
        The fluid's mesh after each step; none where it is not watched.
    iterations : (k,) int array
        Coupling iterations of each step.
    mesh_seconds, seconds : (k,) arrays
        Of the mesh solver, and of the whole, in each step.
    cpu_seconds : float
        Of all processes together, from their start to their end.
    """

    times: NDArray[np.float64]
    displacements: NDArray[np.float64]
    forces: NDArray[np.float64]
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
    """The reason why the benchmark cannot run with :func:`kratos_python`, and the remedy; empty if it can run."""
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
    """Write meshes and material into the folder, which is emptied first; return the fluid's mesh."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    rows, columns, order = size.wall
    mesh = channel_mesh(order * rows, size.coarsest)
    write_fluid(folder / "fluid.mdpa", mesh, {"DENSITY": FLUID_DENSITY, "DYNAMIC_VISCOSITY": VISCOSITY})
    wall = write_solid(folder / "solid.mdpa", wall_lattice(rows, columns, order), order)
    material = parameters.materials("Stress", SOLID_DENSITY, YOUNG, POISSON)
    (folder / "materials.json").write_text(json.dumps(material))
    watch(folder, wall, list(POINTS.values()), ["interface"], meshes=True)
    return mesh


def watch(
    folder: Path, solid: NDArray[np.float64], points: Sequence[Sequence[float]], forces: list[str], *, meshes: bool
) -> None:
    """Select the run's output: the solid's nodes at ``points``, the force on parts of the fluid, its meshes."""
    nodes = [1 + int(np.argmin(((solid - point) ** 2).sum(axis=1))) for point in points]
    (folder / "watch.json").write_text(json.dumps({"nodes": nodes, "forces": forces, "meshes": meshes}))


def run(folder: Path, mesh_solver: str, size: Size, progress: Callable[[int, int], None]) -> History:
    """Compute Mok's benchmark with one of ``parameters.MESH_SOLVERS``, in a folder that :func:`prepare` has filled."""
    return compute(folder, CASE, mesh_solver, size.end_time, progress)


def compute(
    folder: Path, case: parameters.Case, mesh_solver: str, end_time: float, progress: Callable[[int, int], None]
) -> History:
    """Compute a case; a run that was stopped continues.

    Parameters
    ----------
    folder : Path
        With the meshes, the material and :func:`watch`.
    mesh_solver : str
        One of ``parameters.MESH_SOLVERS``.
    end_time : float
        s.
    progress : callable
        Takes the number of finished time steps and the number of all.

    Raises
    ------
    RunFailed
    """
    settings = parameters.MESH_SOLVERS[mesh_solver]
    if "remote" in settings:
        settings = settings | {"remote": settings["remote"] | {"method": case.method}}
    end = end_time - case.time_step / 2.0  # so that round-off adds no step
    (folder / "coupling.json").write_text(json.dumps(parameters.coupling(case, settings, end), indent=1))
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with _server(folder / "server" if "remote" in settings else None) as endpoint:
        _kratos(folder, endpoint, progress)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return History(**np.load(folder / "history.npz"), cpu_seconds=cpu)


@contextmanager
def _server(state: Path | None) -> Iterator[str]:
    """A private server's endpoint, empty if no server is wanted; its sessions are kept for a run that continues."""
    server = EmbeddedServer(state, 300.0, ["--threads", "1"]) if state else None
    try:
        yield server.endpoint if server else ""
    finally:
        if server:
            server.stop()


def _kratos(folder: Path, endpoint: str, progress: Callable[[int, int], None]) -> None:
    """Run Kratos' process to its end; one thread, like the server."""
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
