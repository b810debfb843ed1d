"""A server, a plate of triangles, a stand-in for the model part, and jobs for Kratos' Python."""

import json
import os
import subprocess
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from mesh_motion_client.embedded import EmbeddedServer
from mok_benchmark.execution import kratos_python

ROOT = Path(__file__).resolve().parents[3]
PLAYER = Path(__file__).with_name("play_in_kratos.py")
PATIENCE = 240.0


@pytest.fixture(scope="session")
def run_in_kratos():
    """Runs a script in Kratos' Python, in a folder; skips without Kratos or the client's packages."""
    imports = "import zmq, msgpack, numpy, KratosMultiphysics.MeshMovingApplication"
    try:
        done = subprocess.run([kratos_python(), "-c", imports], capture_output=True, timeout=PATIENCE, check=False)
    except OSError as error:
        pytest.skip(f"KRATOS_PYTHON cannot be run: {error.strerror}")
    if done.returncode:
        pytest.skip("Kratos is not installed (adapters/kratos/README.md; KRATOS_PYTHON names its interpreter)")
    path = [str(ROOT / inner) for inner in ("adapters/python", "adapters/kratos")]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(path), "OMP_NUM_THREADS": "1"}

    def run(script, *arguments, folder):
        return subprocess.run(
            [kratos_python(), str(script), *map(str, arguments)], cwd=folder, env=environment,
            capture_output=True, text=True, timeout=PATIENCE, check=False,
        )  # fmt: skip

    return run


@pytest.fixture(scope="session")
def mesh_motion_server(tmp_path_factory):
    server = EmbeddedServer(tmp_path_factory.mktemp("state"), 120.0, ["--threads", "1"])
    yield server
    server.stop()


@dataclass
class Plate:
    points: np.ndarray
    triangles: np.ndarray

    @property
    def boundary(self):
        return np.flatnonzero(((self.points == 0.0) | (self.points == 1.0)).any(axis=1))

    def at(self, axis, value):
        return np.flatnonzero(self.points[:, axis] == value)

    def turned(self, angle, centre=0.5):
        """Displacements of all nodes for a rotation about a point of the diagonal."""
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        return (self.points - centre) @ turn.T + centre - self.points


@pytest.fixture(scope="session")
def plate():
    n = 7
    x, y = np.meshgrid(np.linspace(0.0, 1.0, n), np.linspace(0.0, 1.0, n))
    corners = np.array([n * j + i for j in range(n - 1) for i in range(n - 1)])
    lower = np.column_stack([corners, corners + 1, corners + n + 1])
    upper = np.column_stack([corners, corners + n + 1, corners + n])
    return Plate(np.column_stack([x.ravel(), y.ravel()]), np.vstack([lower, upper]))


@dataclass
class Job:
    """A folder with a job for Kratos' Python."""

    runner: Callable[..., subprocess.CompletedProcess[str]]
    endpoint: str
    folder: Path
    mesh: dict[str, np.ndarray]
    output: str = field(default="")

    def play(self, steps, **changes):
        self.write(self.folder, steps, **changes)
        assert self.run([self.folder]) == [""], self.output[-4000:]
        return dict(np.load(self.folder / "result.npz"))

    def write(self, folder, steps, *, fix=None, remote=None, solver=None, **further):
        settings = {"solver_type": "mesh_motion_kratos.remote_mesh_motion"} | (solver or {})
        if settings["solver_type"].startswith("mesh_motion_kratos"):
            settings["remote"] = {"endpoint": self.endpoint} | (remote or {})
        job = {"solver": settings, "fix": {"wall": [0, 1]} if fix is None else fix, "steps": steps} | further
        (folder / "job.json").write_text(json.dumps(job, default=np.ndarray.tolist))
        np.savez(folder / "mesh.npz", **self.mesh)

    def run(self, folders):
        done = self.runner(PLAYER, *folders, folder=self.folder)
        self.output = done.stdout + done.stderr
        assert done.returncode == 0, self.output[-4000:]
        return [line.removeprefix("ended: ") for line in done.stdout.splitlines() if line.startswith("ended: ")]


@pytest.fixture
def job(run_in_kratos, mesh_motion_server, plate, tmp_path):
    """A job with the plate, whose edge is the part ``wall``."""
    mesh = {"points": plate.points, "cells_triangle": plate.triangles, "part_wall": plate.boundary}
    return Job(run_in_kratos, mesh_motion_server.endpoint, tmp_path, mesh)


class StandInPart:
    """The plate in the form that the participant needs, with arrays instead of a Kratos model part."""

    def __init__(self, plate):
        self._initial = plate.points.copy()
        self._current = plate.points.copy()
        self.values = np.zeros_like(plate.points)
        self.fixed = np.zeros(plate.points.shape, dtype=bool)
        self.fixed[plate.boundary] = True
        self.node_ids = 10 + 2 * np.arange(len(plate.points))
        self.cells = {"triangle": plate.triangles}
        self.cell_ids = {"triangle": 1000 + np.arange(len(plate.triangles))}
        self.parts = {"wall": plate.boundary, "top": plate.at(1, 1.0), "left": plate.at(0, 0.0)}

    def initial_points(self):
        return self._initial

    def current_points(self):
        return self._current

    def prescribed(self):
        return self.fixed

    def displacements(self):
        return self.values.copy()

    def set_displacements(self, displacements):
        """With Kratos the base class moves the nodes afterwards."""
        self.values = displacements.copy()
        self._current = self._initial + displacements

    def rows_of(self, name):
        return self.parts[name]


@pytest.fixture
def stand_in(plate):
    return StandInPart(plate)
