"""Jᵀ w of the server and of IDWarp: ``python -m benchmarks.gradients MESH FOLDER REPEAT`` prints JSON.

Both use the same mesh, steps and weights w; the weights decrease from the body outwards, like those of a force on the
body. The derivatives by 30 shape parameters are compared: polynomials of second degree that displace the body. IDWarp
runs with one thread in the Python that ``IDWARP_PYTHON`` names; without it only the server is measured.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from dataclasses import asdict
from functools import partial
from pathlib import Path

import numpy as np
from mesh_motion_numerics.method import Method
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from benchmarks.peers.meshes import load_or_build
from benchmarks.peers.motions import MOTIONS
from benchmarks.peers.systems import SYSTEMS, PythonSystem
from benchmarks.peers.task import Task
from benchmarks.scale.cases import MESHES
from benchmarks.scale.figures import Seconds, timed
from benchmarks.scale.library import model_of
from mesh_motion_server.session.factors import FactorCache

__all__ = ["compared"]

Floats = NDArray[np.float64]

#: Parts of the large motion: the first steps need no correction.
_PARTS = 50
#: Of the body's extent: where the weights have fallen to a third.
_NEAR = 0.1
_CACHE_BYTES = 2**31


def compared(mesh: str, folder: Path, repeat: int) -> dict[str, object]:
    """Seconds of the server; if IDWarp is installed also IDWarp's, and the cosine between the gradients."""
    built = load_or_build(mesh, folder)
    body = built.points[built.moving]
    displacements = MOTIONS[MESHES[mesh]].displacements(body, _PARTS)[:repeat]
    task = Task(built.points, built.cells, built.moving, built.fixed, displacements)
    away = cKDTree(body).query(task.points)[0] / np.ptp(body, axis=0).max()
    weights = np.exp(-((away / _NEAR) ** 2))[:, None] * np.cos(3.0 * task.points)
    step, cotangent, ours = _of_server(task, weights, repeat)
    found: dict[str, object] = {"step": asdict(step), "cotangent": asdict(cotangent)}
    idwarp = SYSTEMS["idwarp"]
    reason = idwarp.missing()
    if reason:
        return found | {"idwarp": reason}
    assert isinstance(idwarp, PythonSystem)
    seconds, others = _of_idwarp(idwarp.interpreter, task, weights, repeat)
    shapes = _shapes((body - body.mean(axis=0)) / np.ptp(body, axis=0))
    a, b = (shapes.T @ ours).ravel(), (shapes.T @ others).ravel()
    return found | {"idwarp": seconds, "cosine": float(a @ b / np.linalg.norm(a) / np.linalg.norm(b))}


def _of_server(task: Task, weights: Floats, repeat: int) -> tuple[Seconds, Seconds, Floats]:
    """The shortest time of a step and of Jᵀ w (preparation included), and the gradient (k, 3) after the last step."""
    model, factors, points, steps = model_of(task, Method()), FactorCache(_CACHE_BYTES), task.points, []
    for step in range(task.steps):
        seconds, motion = timed(partial(model.move, points, task.targets(step), factors))
        points = motion.points
        steps.append(seconds)
    vectors = [timed(lambda: model.slope(points, factors).cotangent(weights)) for _ in range(repeat)]
    return Seconds.shortest(steps), Seconds.shortest([seconds for seconds, _ in vectors]), vectors[-1][1]


def _of_idwarp(python: str, task: Task, weights: Floats, repeat: int) -> tuple[dict[str, float], Floats]:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        task.save(folder / "task.npz")
        np.save(folder / "weights.npy", weights)
        subprocess.run(
            [python, "-m", "benchmarks.peers.idwarp_gradient", name, str(repeat)],
            env={**os.environ, "OMP_NUM_THREADS": "1"},
            stdout=subprocess.DEVNULL,
            check=True,
        )
        return json.loads((folder / "seconds.json").read_text(encoding="utf-8")), np.load(folder / "gradient.npy")


def _shapes(places: Floats) -> Floats:
    """(k, 10) orthonormal polynomials of second degree at (k, 3) places."""
    x, y, z = places.T
    found: Floats = np.linalg.qr(np.stack([1.0 + 0.0 * x, x, y, z, x * x, y * y, z * z, x * y, y * z, z * x], axis=1))[
        0
    ]
    return found


def main(arguments: list[str]) -> None:
    """Run the command line that the module's docstring describes."""
    mesh, folder, repeat = arguments
    print(json.dumps(compared(mesh, Path(folder), int(repeat))))


if __name__ == "__main__":
    main(sys.argv[1:])
