"""Tests with the real preCICE, if it is installed: the scripts of the stub, and the tutorial."""

import importlib.util
import json
import os
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from loaded_scripts import loaded
from mesh_motion_precice import read_configuration
from precice_stub import Script

HERE = Path(__file__).parent
ROOT = HERE.parents[2]
TUTORIAL = ROOT / "adapters" / "precice" / "tutorial"
needs_precice = pytest.mark.skipif(
    importlib.util.find_spec("precice") is None, reason="preCICE 3 and its Python bindings are not installed"
)


def started(folder, *command):
    paths = [HERE, ROOT / "adapters" / "precice", os.environ.get("PYTHONPATH", "")]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, map(str, paths)))}
    command = [sys.executable, *map(str, command)]
    with (folder / f"log.{len(list(folder.glob('log.*')))}").open("w") as log:
        return subprocess.Popen(command, cwd=folder, env=environment, stdout=log, stderr=log)


def finished(folder, *participants, seconds=120):
    try:
        for process in reversed(participants):  # ours first: one that ends early leaves the others waiting
            assert process.wait(seconds) == 0, "\n".join(path.read_text()[-2000:] for path in folder.glob("log.*"))
    finally:
        for process in participants:
            process.kill()
            process.wait()


@pytest.fixture
def coupled(case, square, server, tmp_path):
    """Starts the other participant of a script, and ours."""

    def start(values, coupling=""):
        from real_partner import config  # noqa: PLC0415  (imports preCICE)

        wet = np.union1d(square.patches["lower"].nodes, square.patches["upper"].nodes)
        (tmp_path / "precice-config.xml").write_text(config(values))
        partner = values | {"points": square.points.tolist(), "wet": wet.tolist()}
        (tmp_path / "partner.json").write_text(json.dumps(partner))
        file = case(coupling)
        file.write_text(file.read_text().replace("script.json", "precice-config.xml"))
        partner = started(tmp_path, HERE / "real_partner.py", tmp_path)
        return partner, started(tmp_path, "-m", "mesh_motion_precice", file, "--server", server.endpoint), wet

    return start


@needs_precice
@pytest.mark.parametrize(
    ("iterations", "more", "coupling"),
    [
        ([1, 1, 1], {"explicit": True}, ""),
        ([3, 3], {}, ""),
        ([2, 2], {}, "time_step = 0.04"),
        ([2, 2], {"mapping": "nearest-projection", "wait_in_finalize": True}, ""),
        ([2, 2], {"mapping": "linear-cell-interpolation"}, ""),
    ],
    ids=["explicit", "implicit", "steps", "projection", "cells"],
)
def test_a_script_gives_what_the_client_gives(iterations, more, coupling, coupled, script, square, server, tmp_path):
    values = script(iterations, **more)
    partner, ours, wet = coupled(values, coupling)
    finished(tmp_path, partner, ours)
    logs = "".join(path.read_text() for path in tmp_path.glob("log.*"))
    assert "connectivity" not in logs  # preCICE warns where a mapping does not find the cells it needs
    with np.load(tmp_path / "read.npz") as read, server.open(square, {"support_radius": 0.8}) as session:
        for window, found in enumerate(read["arr_0"]):
            rows = Script(values).displacement(square.points[wet], window, iterations[window], 1.0)
            expected = session.move(rows, frame="reference").displacement
            session.commit()
            np.testing.assert_allclose(found, expected, atol=1e-14)
        session.close("discard")


@needs_precice
def test_a_refusal_ends_all_although_they_wait_in_finalize(coupled, script, tmp_path):
    values = script([1, 1], window=3.0, motion=[[5.0, 0.0], [0.0, 5.0]], wait_in_finalize=True)
    partner, ours, _ = coupled(values)
    try:
        assert ours.wait(60) == 1
        assert partner.wait(60) != 0
    finally:
        for process in (partner, ours):
            process.kill()
            process.wait()
    said = "".join(path.read_text() for path in tmp_path.glob("log.*"))
    assert "mesh-motion-precice: " in said


@needs_precice
@pytest.mark.slow
def test_the_tutorial_gives_the_monolithic_motion(server, tmp_path):
    """Fluid, Solid and MeshMotion in preCICE's multi coupling: the beam with the added mass in its own mass matrix."""
    config = TUTORIAL / "precice-config.xml"
    solvers = [started(tmp_path, TUTORIAL / "solvers.py", name, "--config", config) for name in ("Fluid", "Solid")]
    options = ["--server", server.endpoint, "--config", config]
    ours = started(tmp_path, "-m", "mesh_motion_precice", TUTORIAL / "precice-adapter-config.json", *options)
    finished(tmp_path, *solvers, ours)
    monolithic = loaded(ROOT / "tests" / "integration" / "test_mock_fsi.py")
    with np.load(ROOT / "examples" / "turek_hron_flag" / "mesh.npz") as mesh:
        wet = mesh["points"][np.unique(mesh["patch_flag"])]
    tips = np.loadtxt(tmp_path / "tip.csv")[:, 1]
    expected = monolithic.monolithic_tip(wet, len(tips))
    np.testing.assert_allclose(tips, expected, atol=1e-6 * np.abs(expected).max() * 10)


def test_the_tutorial_s_files_fit():
    """The configuration gives MeshMotion exactly the meshes and data that it names; no preCICE is needed for this."""
    ours = read_configuration(TUTORIAL / "precice-adapter-config.json")
    text = ours.precice_config.read_text()
    root = ET.fromstring(text.replace("data:vector", "data-vector").replace("m2n:", "m2n-").replace("mapping:", "")
                         .replace("coupling-scheme:", "").replace("acceleration:", ""))  # fmt: skip
    participant = next(p for p in root.iter("participant") if p.get("name") == ours.participant and len(p))
    read = {(entry.get("mesh"), entry.get("name")) for entry in participant.iter("read-data")}
    assert read == {(surface.mesh, surface.data) for surface in ours.surfaces}
    written = {(entry.get("mesh"), entry.get("name")) for entry in participant.iter("write-data")}
    assert written == {(ours.volume.mesh, ours.volume.data)}
    received = {entry.get("name") for entry in participant.iter("receive-mesh") if entry.get("api-access") == "true"}
    assert (ours.volume.mesh in received) == ours.volume.received
    assert ours.mesh_file.is_file()
    for name in [ours.volume.mesh, *(surface.mesh for surface in ours.surfaces)]:  # as the schema wants a mesh's name
        assert re.fullmatch(r"[A-Z][a-zA-Z0-9]*(-[A-Z][a-zA-Z0-9]*)*-Mesh(-[A-Z][a-zA-Z0-9]*)*", name)
