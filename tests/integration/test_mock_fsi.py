"""Implicit coupling over real sockets: mock fluid, mock solid and server in separate processes.

The load stub and the beam are both linear, so the coupled result has a monolithic counterpart: the beam with the added
mass in its own mass matrix. The partitioned run must reproduce it to the tolerance of its iterations.
"""

import csv
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from loaded_scripts import loaded
from python_runs import said_by_python

EXAMPLES = Path(__file__).parents[2] / "examples"
STEPS, DT = 7, 0.05
ADDED_MASS, AMPLITUDE, FREQUENCY = 20.0, 30.0, 1.0


def monolithic_tip(points: np.ndarray, steps: int) -> np.ndarray:
    """(steps,) tip deflection of the beam that carries the added mass itself."""
    solid = loaded(EXAMPLES / "mock_fsi" / "solid.py")
    beam = solid.Beam()
    shape = beam.modes(points)[:, 1, :]
    share = 0.35 / len(points)
    modal_mass = beam.mass * beam.length
    mass = modal_mass * np.eye(2) + ADDED_MASS * share * shape.T @ shape
    stiffness = np.diag(modal_mass * beam.frequencies**2)
    q, v, a = np.zeros((3, 2))
    tips = []
    for step in range(1, steps + 1):
        pressure = AMPLITUDE * np.sin(2 * np.pi * FREQUENCY * step * DT)
        force = share * pressure * shape.sum(axis=0)
        predicted = q + DT * v + DT**2 * 0.25 * a
        new = np.linalg.solve(mass + 0.25 * DT**2 * stiffness, force - stiffness @ predicted)
        q, v, a = predicted + 0.25 * DT**2 * new, v + 0.5 * DT * (a + new), new
        tips.append(shape[np.argmax(points[:, 0])] @ q)
    return np.array(tips)


@pytest.fixture
def solid_endpoint():
    command = [sys.executable, str(EXAMPLES / "mock_fsi" / "solid.py"), "--bind", "tcp://127.0.0.1:*", "--dt", str(DT)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        yield process.stdout.readline().rsplit(maxsplit=1)[-1]
        process.terminate()


@pytest.mark.slow
def test_coupled_history_equals_the_monolithic_one(solid_endpoint: str, tmp_path: Path) -> None:
    said_by_python(
        *(EXAMPLES / "mock_fsi" / "fluid.py", "--solid", solid_endpoint, "--out", tmp_path),
        *("--steps", STEPS, "--dt", DT, "--added-mass", ADDED_MASS, "--amplitude", AMPLITUDE, "--frequency", FREQUENCY),
        timeout=240,
    )
    rows = list(csv.DictReader((tmp_path / "fsi.csv").read_text().splitlines()))
    with np.load(EXAMPLES / "turek_hron_flag" / "mesh.npz") as mesh:
        wet = np.unique(mesh["patch_flag"])
        points = mesh["points"][wet]
    tips = np.array([float(row["tip"]) for row in rows])
    expected = monolithic_tip(points, STEPS)
    np.testing.assert_allclose(tips, expected, atol=1e-7)  # residual 1e-9, amplified by the coupling's contraction
    assert np.max(np.abs(expected)) > 0.01  # the flag moves by half its thickness and more
    assert all(int(row["iterations"]) > 1 for row in rows)  # implicit: no step converged at once
    assert all(float(row["min_quality"]) > 0 for row in rows)
