"""Every system keeps the convention: exact boundary, one set of positions per step; a missing system is reported."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.peers.__main__ import main
from benchmarks.peers.comparison import compare
from benchmarks.peers.judge import Judge
from benchmarks.peers.measurement import Measurement, SystemFailure
from benchmarks.peers.movers.dense_rbf import DenseRBF
from benchmarks.peers.movers.small_task import small_task
from benchmarks.peers.report import markdown
from benchmarks.peers.systems import SYSTEMS, PythonSystem, System
from benchmarks.peers.task import Task, step_file

LONG = ("ours-iterated", "ours-served", "ours-one-scale")


def marks(name: str, system: System) -> list[pytest.MarkDecorator]:
    """Skip systems that are not installed; whole runs of our own systems take longest, and other tests cover their
    parts.
    """
    nightly = [pytest.mark.nightly] if name in LONG else []
    reason = system.missing()
    return [*nightly, pytest.mark.skip(reason=reason)] if reason else nightly


#: Every code on triangles, the other systems on tetrahedra as well.
INSTALLED = [
    pytest.param(name, kind, marks=marks(name, system))
    for name, system in SYSTEMS.items()
    for kind in ("triangle", "tetra")
    if (kind == "triangle" and name not in ("ours-maximum", "idwarp"))
    or (kind == "tetra" and name in ("dense-rbf", "openfoam", "kratos-laplacian", "idwarp"))
]


def gentle_task(kind: str = "triangle", steps: int = 2) -> Task:
    """The small task with a displacement that every system survives."""
    dimension = {"triangle": 2, "tetra": 3}[kind]
    shell = Task(np.empty((0, dimension)), {kind: np.empty(0)}, np.empty(0), np.empty(0), np.empty(0))
    task = small_task(shell)
    fractions = np.arange(1, steps + 1) / steps
    return replace(task, displacements=0.05 * fractions[:, None, None] * np.ones((1, len(task.moving), dimension)))


@pytest.mark.parametrize(("name", "kind"), INSTALLED)
def test_a_small_motion_is_valid_and_exact_on_the_boundary(tmp_path: Path, name: str, kind: str) -> None:
    task = gentle_task(kind)
    measurement = SYSTEMS[name].move(task, tmp_path, threads=1)
    assert len(measurement.step_seconds) == len(measurement.cpu_seconds) == task.steps
    assert measurement.setup_seconds > 0
    assert measurement.peak_bytes > 10e6
    verdict = Judge(task).verdict(np.load(step_file(tmp_path, step)) for step in range(task.steps))
    assert verdict.inverted == 0
    assert verdict.min_size_skew > 0.1
    assert verdict.boundary_error < 1e-9  # OpenFOAM interpolates the prescribed fields in time


def test_dense_rbf_interpolates_and_decays() -> None:
    """The displacement equals the boundary's at the boundary, and between them φ alone determines it."""
    task = gentle_task(steps=1)
    moved = DenseRBF(task, support_radius=2.5).move(0)
    centres = task.points[np.concatenate([task.moving, task.fixed])]
    r = np.linalg.norm(centres[:, None] - centres, axis=2) / 2.5
    values = np.zeros((len(centres), 2))
    values[: len(task.moving)] = task.displacements[0]
    weights = np.linalg.solve((1 - r) ** 4 * (4 * r + 1), values)
    inner = np.setdiff1d(np.arange(len(task.points)), np.concatenate([task.moving, task.fixed]))[0]
    r = np.linalg.norm(task.points[inner] - centres, axis=1) / 2.5
    expected = task.points[inner] + ((1 - r) ** 4 * (4 * r + 1)) @ weights
    np.testing.assert_allclose(moved[inner], expected, atol=1e-10)


def test_a_system_that_is_not_there_is_reported_not_failed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(SYSTEMS, "absent", PythonSystem("absent", "dense_rbf:DenseRBF", needs="no_such_module"))
    (outcome,) = compare(["M1-T1-1"], ["absent"], tmp_path, threads=1, repeat=1)
    assert outcome.note.startswith("not installed: no module no_such_module")
    assert "| absent | not installed" in markdown([outcome])


class Failing:
    label = "failing"

    def missing(self) -> None:
        return None

    def move(self, task: Task, folder: Path, threads: int) -> Measurement:
        raise SystemFailure("stopped in step 1: sigFpe")


def test_a_system_that_fails_is_a_row_of_the_table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    failing: System = Failing()
    monkeypatch.setitem(SYSTEMS, "failing", failing)
    (outcome,) = compare(["M1-T1-1"], ["failing"], tmp_path, threads=1, repeat=1)
    assert outcome.note == "failed: stopped in step 1: sigFpe"
    assert "| failing | failed: stopped in step 1: sigFpe |" in markdown([outcome])


def test_a_worker_that_dies_says_its_last_line(tmp_path: Path) -> None:
    with pytest.raises(SystemFailure, match="no_such_option"):
        PythonSystem("x", "dense_rbf:DenseRBF", {"no_such_option": "1"}).move(gentle_task(), tmp_path, threads=1)


def test_the_command_writes_table_json_and_plot(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["--out", str(tmp_path), "--cases", "M1-T1-1", "--systems", "dense-rbf", "--threads", "1", "--repeat", "2"])
    assert "min size-skew" in capsys.readouterr().out
    table = (tmp_path / "peers.md").read_text(encoding="utf-8")
    assert "**M1, slab in a square" in table
    assert "| dense RBF in numpy, all centres |" in table
    content = json.loads((tmp_path / "peers.json").read_text(encoding="utf-8"))
    assert content["outcomes"][0]["verdict"]["boundary_error"] == 0
    assert content["machine"]["runs"] == 2
    assert (tmp_path / "peers.png").read_bytes().startswith(b"\x89PNG")
    assert not list((tmp_path / "runs").rglob("*.npy"))
