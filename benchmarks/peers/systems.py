"""The compared systems: how to start each, and whether it can run here."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from benchmarks.peers.measurement import Measurement, SystemFailure
from benchmarks.peers.openfoam import run as openfoam
from benchmarks.peers.openfoam.case import Settings
from benchmarks.peers.task import Task

__all__ = ["SYSTEMS", "OpenFoamSystem", "PythonSystem", "System", "kratos_python"]

_ROOT = Path(__file__).parents[2]
#: Longest time for one motion; a system that takes longer is reported as failed.
_TIMEOUT = 3600
_THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "MESH_MOTION_THREADS")


class System(Protocol):
    """Something that moves a mesh."""

    @property
    def label(self) -> str:
        """Its name in the table."""
        ...

    def missing(self) -> str | None:
        """The reason why the system cannot run here, or None."""
        ...

    def move(self, task: Task, folder: Path, threads: int) -> Measurement:
        """Move the mesh; positions after each step go to files in ``folder``. Raises SystemFailure."""
        ...


def kratos_python() -> str:
    """The Python interpreter with Kratos: $KRATOS_PYTHON, else this one."""
    return os.environ.get("KRATOS_PYTHON", sys.executable)


def idwarp_python() -> str:
    """The Python interpreter with IDWarp: $IDWARP_PYTHON, else this one."""
    return os.environ.get("IDWARP_PYTHON", sys.executable)


@dataclass(frozen=True)
class PythonSystem:
    """A mover in a separate worker process.

    Attributes
    ----------
    place : str
        ``module:Class`` in :mod:`benchmarks.peers.movers`.
    options : dict
        The mover's keyword arguments.
    needs : str
        The module without which the mover cannot run; the mover's interpreter is checked for it.
    python : callable, optional
        Returns the mover's interpreter; None: this one.
    """

    label: str
    place: str
    options: dict[str, Any] = field(default_factory=dict)
    needs: str = "numpy"
    python: Callable[[], str] | None = None

    @property
    def interpreter(self) -> str:
        """The Python that runs it."""
        return self.python() if self.python else sys.executable

    def missing(self) -> str | None:
        """As :meth:`System.missing`."""
        code = f"import importlib.util as u, sys; sys.exit(u.find_spec({self.needs!r}) is None)"
        try:
            found = subprocess.run([self.interpreter, "-c", code], check=False, capture_output=True).returncode == 0
        except OSError:
            found = False
        return None if found else f"not installed: no module {self.needs} in {self.interpreter}"

    def move(self, task: Task, folder: Path, threads: int) -> Measurement:
        """As :meth:`System.move`."""
        task.save(folder / "task.npz")
        place = f"benchmarks.peers.movers.{self.place}"
        arguments = [place, json.dumps(self.options), str(folder / "task.npz"), str(folder)]
        with (folder / "log.worker").open("w", encoding="utf-8") as log:
            try:
                code = subprocess.run(
                    [self.interpreter, "-m", "benchmarks.peers.worker", *arguments],
                    check=False,
                    cwd=_ROOT,
                    env={**os.environ, **dict.fromkeys(_THREAD_VARIABLES, str(threads))},
                    stdout=log,
                    stderr=subprocess.STDOUT,
                    timeout=_TIMEOUT,
                ).returncode
            except subprocess.TimeoutExpired:
                raise SystemFailure(f"took longer than {_TIMEOUT} s") from None
        if code:
            raise SystemFailure(_last_line(folder / "log.worker") or f"ended with code {code}")
        return Measurement.load(folder)


@dataclass(frozen=True)
class OpenFoamSystem:
    """OpenFOAM's displacementLaplacian with a diffusivity that falls with the squared distance; one process."""

    label: str
    settings: Settings

    def missing(self) -> str | None:
        """As :meth:`System.missing`."""
        return openfoam.missing()

    def move(self, task: Task, folder: Path, threads: int) -> Measurement:
        """Move the mesh as in :meth:`System.move`; moveDynamicMesh has one thread and ignores ``threads``."""
        del threads
        return openfoam.move_mesh(task, folder, self.settings)


def _last_line(log: Path) -> str:
    """The last lines of a process' output, shortened."""
    lines = [line.strip() for line in log.read_text(encoding="utf-8", errors="replace").splitlines() if line.strip()]
    return lines[-1][:200] if lines else ""


_KRATOS = "KratosMultiphysics.MeshMovingApplication"

_OURS = "mesh_motion_numerics.motion.motion"
#: The method of the thesis: each step from the committed mesh, cells compared with the equilateral form.
_THESIS = {"displacement": "relative", "quality_metric": "size-skew"}


SYSTEMS: dict[str, System] = {
    "ours": PythonSystem("**mesh-motion server**, nothing set", "ours:MotionModelMover", needs=_OURS),
    "ours-optimised": PythonSystem(
        '**mesh-motion server**, `correction = "optimised"`',
        "ours:MotionModelMover",
        {**_THESIS, "correction": "optimised"},
        needs=_OURS,
    ),
    "ours-maximum": PythonSystem(
        '**mesh-motion server**, `correction_target = "maximum"`',
        "ours:MotionModelMover",
        {**_THESIS, "correction_target": "maximum"},
        needs=_OURS,
    ),
    "ours-served": PythonSystem(
        "mesh-motion server, nothing set, over the wire", "served:ServedMover", needs="mesh_motion_server.transport"
    ),
    "ours-iterated": PythonSystem(
        "mesh-motion server over the wire, 3 coupling iterations a step",
        "served:ServedMover",
        {"iterations": 3},
        needs="mesh_motion_server.transport",
    ),
    "ours-plain": PythonSystem(
        "mesh-motion server, plain RBF",
        "ours:MotionModelMover",
        {**_THESIS, "correction": "none", "allow_invalid": True},
        needs=_OURS,
    ),
    "ours-one-scale": PythonSystem(
        "mesh-motion server, plain RBF, all centres in one scale",
        "ours:MotionModelMover",
        {**_THESIS, "correction": "none", "allow_invalid": True, "solver": "iterative"},
        needs=_OURS,
    ),
    "dense-rbf": PythonSystem("dense RBF in numpy, all centres", "dense_rbf:DenseRBF"),
    "scipy-rbf": PythonSystem("scipy RBFInterpolator, 50 neighbours", "scipy_rbf:ScipyRBF", needs="scipy.interpolate"),
    "openfoam": OpenFoamSystem("OpenFOAM displacementLaplacian, tolerance 1e-5", Settings(tolerance="usual")),
    "openfoam-converged": OpenFoamSystem("OpenFOAM displacementLaplacian, converged", Settings()),
    "openfoam-uncorrected": OpenFoamSystem(
        "OpenFOAM displacementLaplacian, converged, uncorrected", Settings(laplacian="uncorrected")
    ),
    "kratos-laplacian": PythonSystem(
        "Kratos laplacian", "kratos:KratosMover", {"solver": "laplacian"}, needs=_KRATOS, python=kratos_python
    ),
    "kratos-similarity": PythonSystem(
        "Kratos structural_similarity",
        "kratos:KratosMover",
        {"solver": "structural_similarity"},
        needs=_KRATOS,
        python=kratos_python,
    ),
    "idwarp": PythonSystem("IDWarp, fast", "idwarp:IDWarpMover", needs="idwarp", python=idwarp_python),
}
