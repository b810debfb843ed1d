"""The table of OpenFOAM's own tutorials: one row, with both motion solvers and on two processors."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from loaded_scripts import loaded

ADAPTER = Path(__file__).resolve().parents[3] / "adapters" / "openfoam"


@pytest.fixture
def tutorials():
    return loaded(ADAPTER / "tutorials.py")


def test_without_tutorials_it_says_what_to_install(tutorials, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(tutorials, "TUTORIALS", tmp_path / "none")
    monkeypatch.setattr(sys, "argv", ["tutorials.py"])
    assert tutorials.main() == 69
    assert "openfoam-examples" in capsys.readouterr().err


def test_only_the_field_that_the_plugin_reads_is_kept(tutorials, tmp_path):
    """Other cases may have a condition with code, which decomposePar would compile; that fails without wmake, and as
    root.
    """
    mesh = tmp_path / "mesh"
    for name in ("pointDisplacement", "pointDisplacementy", "cellDisplacement"):
        (mesh / "0.orig").mkdir(parents=True, exist_ok=True)
        (mesh / "0.orig" / name).write_text("")
    (mesh / "constant").mkdir()
    case = tutorials.Tutorial("any/where/case", 1, 1.0, "")
    tutorials.prepared(case, mesh, tmp_path / "remote", {}, "body moving;")
    assert [path.name for path in (tmp_path / "remote" / "0").iterdir()] == ["pointDisplacement"]
    tutorials.prepared(case, mesh, tmp_path / "own", {}, "")
    assert len(list((tmp_path / "own" / "0").iterdir())) == 3


@pytest.mark.parametrize("where", ["meshed", "play"])
def test_a_case_that_fails_is_a_row_of_the_table(tutorials, tmp_path, monkeypatch, capsys, where):
    def fail(*_):
        raise tutorials.SetupError("blockMesh: no")

    monkeypatch.setattr(tutorials, "TUTORIALS", tmp_path)
    monkeypatch.setattr(tutorials, "build_library", lambda _: None)
    monkeypatch.setattr(tutorials, "meshed", lambda *_: None)
    monkeypatch.setattr(tutorials, "play", lambda *_: tutorials.Outcome(1.0, 0.5, 0.1))
    monkeypatch.setattr(tutorials, where, fail)
    monkeypatch.setattr(sys, "argv", ["tutorials.py", "--out", str(tmp_path / "out"), "--only", "movingCone"])
    assert tutorials.main() == 1
    rows = capsys.readouterr().out.splitlines()[2:]
    assert len(rows) == 3
    assert all("blockMesh: no" in row for row in rows)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("moveDynamicMesh") is None, reason="OpenFOAM is not installed (Debian: openfoam)")
@pytest.mark.timeout(1200)
def test_the_row_of_the_moving_cone(tutorials, tmp_path):
    if not tutorials.TUTORIALS.is_dir():
        pytest.skip("its tutorials are not installed (Debian: openfoam-examples)")
    command = [sys.executable, str(ADAPTER / "tutorials.py"), "--only", "pimpleFoam movingCone", "--out", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    row = done.stdout.splitlines()[-1]
    original, serial, parallel = re.findall(r"([\d.]+), ([\d.]+) \|", row)
    assert all(float(seconds) > 0.0 for seconds in row.split(" | ")[3:6:2])  # processor time of both motion solvers
    assert original == ("27.3", "0.53")  # OpenFOAM 1912's own
    assert serial == parallel
    assert float(serial[0]) < 65.0
