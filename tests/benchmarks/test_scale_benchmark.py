"""The benchmark of growth: one small case end to end, the tables and the plot, and that the README shows every case."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from scale_figures import FIGURES

from benchmarks.scale import library
from benchmarks.scale.__main__ import main
from benchmarks.scale.cases import CASES, Case
from benchmarks.scale.figures import Rates
from benchmarks.scale.limits import machine_limits
from benchmarks.scale.results import Results
from benchmarks.scale.truth import truth
from benchmarks.scale.work import shares, work


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("meshes")


@pytest.mark.parametrize("kind", ["steady", "large"])
def test_a_case_is_measured(folder: Path, kind: str) -> None:
    figures = library.measured(Case("M1", kind), folder, repeat=2)
    assert 0 < figures.boundary < figures.nodes < figures.cells
    assert figures.boundary_error < 1e-9
    assert not figures.corrected
    assert figures.near_wall >= figures.minimum
    assert (figures.minimum > 0.2) == (kind == "steady")
    assert figures.step.cpu <= figures.first.cpu
    assert figures.resident_bytes > 1e7


@pytest.mark.nightly  # processes of their own, and a server that has to come to rest
def test_the_command_line_measures_the_library_and_the_wire(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("benchmarks.scale.__main__.CASES", {"M1-steady": CASES["M1-steady"]})
    main(["--out", str(tmp_path), "--meshes", str(folder), "--sizes", "M1", "--wire", "M1", "--repeat", "1"])
    found = Results.load(tmp_path / "scale.json")
    assert set(found.library) == set(found.wire) == {"M1-steady"}
    assert all(0 < figures.step_share < 1 for figures in found.wire.values())
    assert "| M1 steady | 723 | 104 |" in (tmp_path / "scale.md").read_text(encoding="utf-8")
    assert (tmp_path / "scale.png").exists()


@pytest.mark.nightly
@pytest.mark.skipif(not any(map(shutil.which, ("c++", "g++", "clang++"))), reason="no C++ compiler is installed")
def test_the_machine_is_measured() -> None:
    limits = machine_limits(numbers=100_000)
    assert np.array([5e-324])[0] * 1.0 > 0.0, "the library that measures makes this process flush denormals"
    assert limits.bandwidth > 1e7
    assert limits.pair_rate > 1e5
    for found in (limits.one, limits.all):
        assert found.triad > 1e8
        assert found.read > 1e8
        assert found.arithmetic > 1e8
        assert found.pairs > 1e6


RATES = Rates(triad=2.0e10, read=3.0e10, arithmetic=5.0e10, pairs=1.0e9)


def test_the_work_of_a_step() -> None:
    found = work(FIGURES, 3)
    assert found["displace"].bytes == 48 * 50_000
    assert found["displace"].flops == (3 * (8 + 32 + 128) + 36) * 50_000
    assert found["predict"].bytes == 24 * 50_000 + 24 * 300_000
    assert found["step"].bytes == found["displace"].bytes + 24 * 300_000
    assert found["step"].seconds(RATES) == found["step"].flops / 5.0e10
    assert [share.phase for share in shares(FIGURES, 3, RATES, 1)] == ["displace", "predict", "step"]


@pytest.mark.nightly
def test_the_truth_is_near_what_two_scales_leave_at_the_wall(folder: Path) -> None:
    case = Case("M3", "large")
    exact, found = truth(case, folder), library.measured(case, folder, repeat=1)
    assert found.near_wall == pytest.approx(exact.near_wall, rel=0.05)
