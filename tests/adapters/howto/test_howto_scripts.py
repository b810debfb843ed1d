"""The scripts for finite-element codes do what their pages say, if the codes are installed.

The codes are searched in the Pythons that NGSOLVE_PYTHON and DOLFINX_PYTHON name, in this Python, and in Debian's,
whose own pyzmq and msgpack the client then uses. The pages: examples/ngsolve_flap/README.md,
examples/dolfinx_channel/README.md, examples/su2_airfoil/README.md, examples/stokes_drag/README.md,
examples/aerofoil_ffd/README.md.
"""

import functools
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from mesh_motion_server.files import read_mesh

ROOT = Path(__file__).parents[3]
NAMED = (os.environ.get("NGSOLVE_PYTHON"), os.environ.get("DOLFINX_PYTHON"))
PYTHONS = (*filter(None, NAMED), sys.executable, "/usr/bin/python3")
PATHS = os.pathsep.join(str(ROOT / part) for part in (".", "adapters/python"))


@functools.cache
def python_with(*modules: str) -> str | None:
    for python in PYTHONS:
        command = [python, "-c", "import " + ", ".join(modules)]
        if Path(python).exists() and subprocess.run(command, capture_output=True, check=False).returncode == 0:
            return python
    return None


@pytest.fixture
def run(server):
    def run_script(script: str, *arguments: object, modules: tuple[str, ...] = ()) -> list[str]:
        python = python_with("msgpack", "zmq", *modules)
        if python is None:
            pytest.skip(f"no Python here imports {', '.join(modules)}")
        environment = os.environ | {"PYTHONPATH": PATHS, "OMP_NUM_THREADS": "1"}
        command = [python, str(ROOT / "examples" / script), "--server", server.endpoint, *map(str, arguments)]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=240, check=False)
        assert done.returncode == 0, done.stderr
        return done.stdout.splitlines()

    return run_script


def numbers(lines: list[str], name: str) -> np.ndarray:
    return np.array([float(re.search(rf"{name} (\S+)", line)[1]) for line in lines])


def test_ngsolve_solves_on_the_moved_mesh(run):
    """The area is that of the channel minus the bent flap; the finite elements see it only through the deformation."""
    lines = run("ngsolve_flap/moving_flap.py", "--steps", 3, modules=("ngsolve",))
    deflection = 0.3 * np.arange(1, 4) / 3
    foot, top = 0.1, 0.6  # the flap's sides are bent alike, its top is a straight line between their ends
    shortened = 2.0 / 3.0 * deflection**2 / top
    np.testing.assert_allclose(numbers(lines, "area"), 4.0 - foot * (top - shortened), atol=1e-8)
    drag = numbers(lines, "drag")
    assert (np.diff(drag) < 0.0).all()  # bent, it blocks less of the channel
    assert (drag > 10.0).all()
    assert (numbers(lines, "size-skew") > 0.2).all()


def test_dolfinx_solves_on_the_moved_mesh(run):
    """Linear functions are solved exactly on every mesh, and the area is that of the channel minus the bump."""
    lines = run("dolfinx_channel/moving_wall.py", "--steps", 4, modules=("dolfinx",))
    nodes = np.linspace(0.0, 4.0, 41)
    bump = np.sin(np.pi * nodes / 4.0) ** 2
    height = 0.5 * np.sin(2.0 * np.pi * np.arange(1, 5) / 4)
    np.testing.assert_allclose(numbers(lines, "area"), 4.0 - height * np.trapezoid(bump, nodes), atol=1e-8)
    assert (numbers(lines, "error") < 1e-12).all()


def test_su2_gets_files_that_differ_in_coordinates_alone(run, tmp_path):
    lines = run("su2_airfoil/pitching_airfoil.py", "--angles", 5, 12, "--out", tmp_path)
    assert (numbers(lines, "size-skew") > 0.1).all()
    before = read_mesh(tmp_path / "naca0012.su2")
    after = read_mesh(tmp_path / "pitched_12.su2")
    np.testing.assert_array_equal(after.cells["quad"], before.cells["quad"])
    foil, far = before.patches["airfoil"], before.patches["farfield"]
    c, s = np.cos(np.radians(12.0)), np.sin(np.radians(12.0))
    arms = before.points[foil] - [0.25, 0.0]
    turned = arms @ np.array([[c, s], [-s, c]]).T + [0.25, 0.0]
    np.testing.assert_allclose(after.points[foil], turned, atol=1e-14)
    np.testing.assert_array_equal(after.points[far], before.points[far])
    other = (tmp_path / "naca0012.su2").read_text().splitlines(), (tmp_path / "pitched_12.su2").read_text().splitlines()
    changed = sum(a != b for a, b in zip(*other, strict=True))
    assert 0 < changed <= len(before.points)


@pytest.mark.nightly
def test_the_body_of_least_drag_is_found(run):
    """The drag of the circle is known exactly; the angle of the tip is at most that of a constant shear stress."""
    lines = run("stokes_drag/least_drag.py", "--iterations", 6, modules=("skfem", "scipy", "matplotlib"))
    exact, difference = numbers(lines[:2], "derivative"), numbers(lines[:2], "differences")
    np.testing.assert_allclose(exact, difference, rtol=1e-6)
    assert numbers(lines[2:3], "circle")[0] == pytest.approx(4.0 * np.pi / (np.log(10.0) - 99.0 / 101.0), rel=1e-4)
    assert numbers(lines[3:9], "drag")[-1] == pytest.approx(8.74, abs=5e-3)
    assert numbers(lines[-2:-1], "area")[0] == pytest.approx(1.0, abs=1e-3)
    assert 75.0 < numbers(lines[-2:-1], "tip")[0] < 102.5


def test_the_parameters_of_an_aerofoil_are_found_from_its_grid(run, tmp_path):
    """By Gauss–Newton, which converges this fast only with exact derivatives."""
    picture = tmp_path / "grid.png"
    lines = run("aerofoil_ffd/morph_aerofoil.py", "--picture", picture, modules=("scipy", "matplotlib"))
    assert numbers([lines[1].replace(",", "")], "differences")[0] < 1e-6
    assert numbers(lines[1:2], "against columns")[0] < 1e-9
    farthest = numbers(lines[3:8], "farthest node")
    assert farthest[0] > 0.07
    assert farthest[1] < 5e-3
    assert farthest[2] < 1e-5
    assert farthest[3] < 1e-9
    assert numbers(lines[-1:], "found to")[0] < 1e-8
    assert picture.stat().st_size > 20_000
