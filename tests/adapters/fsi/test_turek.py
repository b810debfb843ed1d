"""Turek and Hron's flag: the solid alone against CSM3, the first windows of FSI3, the figures of known histories."""

import importlib
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from mesh_motion_calculix import Options, Solid, flap_deck
from mesh_motion_fsi.case import environment, make_case
from mok_benchmark.execution import missing_kratos

ROOT = Path(__file__).resolve().parents[3]
ADAPTER, EXAMPLE = ROOT / "adapters" / "openfoam", ROOT / "examples" / "turek_hron_fsi"
needs_openfoam = pytest.mark.skipif(
    any(shutil.which(name) is None for name in ("pimpleFoam", "ccx", "g++")),
    reason="OpenFOAM, CalculiX or g++ is not installed (Debian: openfoam calculix-ccx g++)",
)


@pytest.fixture
def scripts(monkeypatch):
    monkeypatch.syspath_prepend(str(EXAMPLE))
    names = ("channel", "turek", "proof", "kratos")
    yield {name: importlib.import_module(name) for name in names}
    for name in names:
        sys.modules.pop(name, None)


@pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX is not installed (Debian: calculix-ccx)")
def test_flag_under_its_weight_swings_as_published(scripts, tmp_path):
    """CSM3 of the benchmark: ux -14.305 ± 14.305 mm, uy -63.607 ± 65.160 mm, 1.0995 Hz."""
    (root, middle), length, width = scripts["channel"].FLAG
    deck = tmp_path / "flag.inp"
    deck.write_text(
        flap_deck((2, 24), width=width, height=length, thickness=0.02, foot=(root, middle), axis=(1.0, 0.0),
                  density=1e3, young=1.4e6, poisson=0.4)
    )  # fmt: skip
    dt, tip = 0.02, []
    weight = Options(step_cards=("*DLOAD", "EALL, GRAV, 2., 0., -1., 0."))
    with Solid(deck, "INTERFACE", tmp_path / "run", dimensions=2, options=weight) as solid:
        a = int(np.linalg.norm(solid.points - (root + length, middle), axis=1).argmin())
        for _ in range(50):
            solid.solve(np.zeros_like(solid.points), dt)
            solid.advance()
            tip.append(solid.displacements[a])
    x, y = 1e3 * np.array(tip).T
    assert [(v.max() + v.min()) / 2 for v in (x, y)] == pytest.approx([-14.305, -63.607], rel=0.02)
    assert [np.ptp(v) / 2 for v in (x, y)] == pytest.approx([14.305, 65.160], rel=0.02)
    half = dt * (1 + int(y.argmin()))
    assert half == pytest.approx(0.5 / 1.0995, abs=1.5 * dt)


@needs_openfoam
@pytest.mark.slow
def test_first_windows_and_a_run_that_goes_on(scripts, tmp_path):
    turek, proof = scripts["turek"], scripts["proof"]
    given = ["fsi3", "--out", str(tmp_path), "--refinement", "0.4", "--end"]
    turek.run(turek.arguments([*given, "0.006"]))
    rows = turek.run(turek.arguments([*given, "0.010"]))
    assert [row.window for row in rows] == [1, 2, 3, 4, 5]
    run = proof.read_run(tmp_path)
    np.testing.assert_allclose(run["t"], 0.002 * np.arange(1, 6), rtol=1e-12)
    assert (np.diff(run["drag"]) > 0.0).all()  # the inflow is raised slowly


@needs_openfoam
@pytest.mark.parametrize("refinement", [0.4, 1.0])
def test_mesh_is_one_that_openfoam_calls_good(scripts, tmp_path, refinement):
    case = tmp_path / "fluid"
    files = {"system/blockMeshDict": scripts["channel"].block_mesh(refinement)}
    make_case(EXAMPLE / "fluid", case, "server", ADAPTER, files)
    done = subprocess.run(
        ["checkMesh"], cwd=case, env=os.environ | environment(ADAPTER), capture_output=True, text=True, check=True
    )
    assert "Mesh OK." in done.stdout
    patches = (case / "constant" / "polyMesh" / "boundary").read_text()
    assert all(f"{name}\n" in patches for name in ("inlet", "outlet", "walls", "cylinder", "flag", "frontAndBack"))


def test_in_kratos_the_flag_has_the_mesh_around_it(scripts, tmp_path):
    """The fluid's nodes on the flag are the flag's, and its area is the channel's without cylinder and flag."""
    mesh = scripts["kratos"].prepare(tmp_path, "fsi2", (8, 2), 0.1)
    x, y = mesh.points[mesh.triangles].transpose(2, 1, 0)
    areas = 0.5 * ((x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0]))
    assert areas.min() > 0.0
    assert areas.sum() == pytest.approx(2.5 * 0.41 - np.pi * 0.05**2 - 0.35 * 0.02, rel=1e-3)
    lines = (tmp_path / "solid.mdpa").read_text().split("Begin Nodes\n")[1].split("End Nodes")[0].splitlines()
    solid = np.array([line.split()[1:3] for line in lines if line.strip()], dtype=float)
    wetted = mesh.points[np.unique(mesh.edges["interface"])]
    assert len(wetted) == 2 * 17 + 3
    assert np.linalg.norm(wetted[:, None] - solid, axis=2).min(axis=1).max() < 1e-9
    (a,) = json.loads((tmp_path / "watch.json").read_text())["nodes"]
    np.testing.assert_allclose(solid[a - 1], (0.6, 0.2), atol=1e-12)


@pytest.mark.nightly
def test_in_kratos_a_run_goes_on_where_it_stopped(scripts, tmp_path):
    """26 steps on a coarse mesh, in one run and in two: equal within the tolerance of the coupling."""
    kratos = scripts["kratos"]
    if missing_kratos():
        pytest.skip("Kratos is not installed (adapters/kratos/README.md; KRATOS_PYTHON names its interpreter)")

    def run(name, end):
        size = ["--elements", "8", "--coarsest", "0.1", "--dt", "0.04", "--end", end]
        return kratos.run(kratos.arguments(["fsi2", "--out", str(tmp_path / name), *size]))

    assert len(run("stopped", "1.0").times) == 25
    session = (tmp_path / "stopped" / "session.json").read_text()
    stopped, whole = run("stopped", "1.12"), run("whole", "1.12")
    assert (tmp_path / "stopped" / "session.json").read_text() == session
    np.testing.assert_allclose(stopped.times, 0.04 * np.arange(1, 29), rtol=1e-12)
    largest = np.abs(whole.displacements).max()
    assert largest > 1e-4
    assert np.abs(stopped.displacements - whole.displacements)[25:].max() < 1e-3 * largest
    assert whole.forces[-1, 0] > 10.0  # drag, while the inflow is raised


def known(scripts, *, amplitude=34.38, hertz=5.3):
    """A run of FSI3 with the published figures, or with other values of uy."""
    t = 0.002 * np.arange(1, 3001)
    grown = np.minimum(1.0, t / 3.0)
    published = scripts["proof"].PUBLISHED["fsi3"] | {"uy": (1.48, amplitude, hertz)}
    return {"t": t} | {
        name: mean + grown * swing * np.sin(2.0 * np.pi * f * t) for name, (mean, swing, f) in published.items()
    }


def test_figures_of_a_known_oscillation(scripts):
    proof, run = scripts["proof"], known(scripts)
    for name in proof.NAMES:
        found = proof.figures(run["t"], run[name], 1.0 / 5.3)
        mean, amplitude, hertz = proof.PUBLISHED["fsi3"][name]
        assert (found.mean, found.amplitude) == pytest.approx((mean, amplitude), abs=0.005 * amplitude)
        assert found.frequency == pytest.approx(hertz, rel=1e-3)


@pytest.mark.parametrize(
    ("change", "good"),
    [({}, True), ({"amplitude": 34.38 * 1.06}, False), ({"hertz": 5.3 * 0.97}, False), ({"hertz": 5.4}, True)],
)
def test_the_verdict_is_that_of_the_fine_mesh(scripts, tmp_path, change, good):
    proof = scripts["proof"]
    runs = {"coarse": known(scripts, amplitude=20.0), "fine": known(scripts, **change)}
    lines, passed = proof.judge("fsi3", runs)
    assert passed is good
    assert lines[-1].endswith("PASS" if good else "FAIL")
    proof.draw("fsi3", runs, tmp_path / "fsi3.png")
    assert (tmp_path / "fsi3.png").stat().st_size > 10_000
    assert not proof.judge("fsi3", {})[1]
    assert not proof.judge("fsi3", {"control": known(scripts)})[1]


def test_the_kept_histories_are_those_of_the_pages(scripts):
    proof, tables = scripts["proof"], []
    of_openfoam, of_kratos = ["coarse", "middle", "fine"], ["kratos-coarse", "kratos", "kratos-control"]
    for case, names in (("fsi2", of_openfoam[:2]), ("fsi2", of_kratos), ("fsi3", of_openfoam)):
        runs = {name: dict(np.load(EXAMPLE / "results" / f"{case}-{name}.npz")) for name in names}
        tables += [line.replace("-", "−") for line in proof.judge(case, runs)[0] if line.startswith("| ")]
    for page in (EXAMPLE / "README.md", ROOT / "docs" / "fsi.md"):
        assert not set(tables) - set(page.read_text("utf-8").splitlines())
