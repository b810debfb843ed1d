"""The run of all benchmarks: one case, the aims on artificial figures, and a short run of every kind end to end."""

import subprocess
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.correction.cases import CASES as CORRECTIONS
from benchmarks.correction.cost import Cost
from benchmarks.fresh import measured_in_fresh_process
from benchmarks.peers.comparison import CASES as PEERS
from benchmarks.peers.comparison import Outcome
from benchmarks.peers.judge import Verdict
from benchmarks.peers.measurement import Measurement
from benchmarks.peers.meshes import MESHES
from benchmarks.peers.systems import SYSTEMS
from benchmarks.scale import library
from benchmarks.scale.cases import CASES as SCALE
from benchmarks.scale.cases import Case
from benchmarks.scale.figures import Figures, MachineLimits, Rates, Seconds, WireFigures
from benchmarks.scale.results import Results
from benchmarks.scale.truth import Truth
from benchmarks.scale.work import shares, work
from benchmarks.summary import command
from benchmarks.summary.aims import Row, anchor, rows
from benchmarks.summary.evidence import Evidence
from benchmarks.summary.plan import PLANS, Job

FIGURES = Figures(
    nodes=50_000,
    cells=300_000,
    boundary=6000,
    setup=Seconds(0.25, 0.26),
    first=Seconds(0.09, 0.1),
    step=Seconds(0.08, 0.085),
    iteration=Seconds(0.04, 0.041),
    brief=Seconds(0.03, 0.031),
    solve=Seconds(0.05, 0.05),
    displace=Seconds(0.0125, 0.012),
    predict=Seconds(0.011, 0.01),
    judge_brief=Seconds(0.005, 0.004),
    kept_bytes=5_000_000,
    peak_bytes=10_000_000,
    resident_bytes=270_000_000,
    minimum=0.43,
    near_wall=0.44,
    inverted=0,
    boundary_error=5e-14,
    corrected=False,
)
RATES = Rates(triad=2.0e10, read=3.0e10, arithmetic=5.0e10, pairs=1.0e9)


def figures(nodes: int, step: float) -> Figures:
    iteration, brief = Seconds(step, step / 2), Seconds(0.9 * step, step / 2.1)
    times = {"step": Seconds(2 * step, step), "iteration": iteration, "brief": brief, "judge_brief": Seconds(0.1, 0.04)}
    return replace(
        FIGURES,
        nodes=nodes,
        cells=6 * nodes,
        kept_bytes=100 * nodes,
        peak_bytes=300 * nodes,
        resident_bytes=4_100_000_000,
        near_wall=0.4,
        **times,
    )


def outcome(case: str, system: str, seconds: float, minimum: float = 0.1) -> Outcome:
    inverted = 3 if minimum < 0 else 0
    verdict = Verdict(minimum, 0.7, *[minimum] * 4, inverted, inverted, 0.0, 66.04, 24.0, 2, inverted)
    return Outcome(case, system, Measurement(1.0, [seconds], [2 * seconds], 10**8), verdict, "", 0.0)


@pytest.fixture
def evidence() -> Evidence:
    rate = Rates(2e10, 2e10, 5e10, 1e9)
    results = Results(MachineLimits(2e10, 1e8, rate, rate, 2), "A machine.", threads=2)
    results.library = {
        "M3-steady": figures(50_144, 0.05),
        "M5-steady": figures(4_887_591, 5.0),
        "M3-large": figures(50_144, 0.05),
    }
    results.wire = {"M4-steady": WireFigures(*[Seconds(0.1, 0.1)] * 4, 0.12, 0.1, 50, 20)}
    found = Evidence(results, {"M3-large": Truth(0.11, 0.41)})
    found.costs["M3-0.28"] = Cost(50_144, 44_000, 3000, 0.118, 0.2801, 15, 4.0, 4.0, 3.0, 10**8)
    return found


def row(evidence: Evidence, start: str) -> Row:
    return next(found for found in rows(evidence) if found.what.startswith(start))


@pytest.mark.parametrize("kind", ["steady", "large"])
def test_a_case_is_measured(tmp_path: Path, kind: str) -> None:
    figures = library.measured(Case("M1", kind), tmp_path, repeat=2)
    assert 0 < figures.boundary < figures.nodes < figures.cells
    assert figures.boundary_error < 1e-9
    assert not figures.corrected
    assert figures.near_wall >= figures.minimum
    assert (figures.minimum > 0.2) == (kind == "steady")
    assert figures.step.cpu <= figures.first.cpu
    assert figures.resident_bytes > 1e7


def test_the_work_of_a_step() -> None:
    found = work(FIGURES, 3)
    assert found["displace"].bytes == 48 * 50_000
    assert found["displace"].flops == (3 * (8 + 32 + 128) + 36) * 50_000
    assert found["predict"].bytes == 24 * 50_000 + 24 * 300_000
    assert found["step"].bytes == found["displace"].bytes + 24 * 300_000
    assert found["step"].seconds(RATES) == found["step"].flops / 5.0e10
    assert [share.phase for share in shares(FIGURES, 3, RATES, 1)] == ["displace", "predict", "step"]


def test_seconds_are_measured_by_the_dense_sum(evidence: Evidence) -> None:
    assert anchor(evidence).factor == pytest.approx(0.5)  # 50 M pairs/s there, 100 here
    evidence.outcomes.append(outcome("M3-T3-1", "dense-rbf", 8.8))
    assert anchor(evidence).factor == pytest.approx(0.5)
    evidence.results.limits = replace(evidence.results.limits, pair_rate=1e7)
    assert anchor(evidence).factor == pytest.approx(2.0)
    assert row(evidence, "M3, 3D").asked == "≤ 0.03 s (0.015 there)"
    evidence.outcomes.append(outcome("M4-T3-1", "dense-rbf", 202.5))
    assert anchor(evidence).factor == pytest.approx(1.5)
    assert "M4" in anchor(evidence).text
    evidence.results.threads = 1  # processor time is twice as much
    assert anchor(evidence).factor == pytest.approx(3.0)


def test_an_aim_is_met_or_not_or_not_measured(evidence: Evidence) -> None:
    evidence.results.limits = replace(evidence.results.limits, pair_rate=5e7)
    evidence.outcomes.append(outcome("M3-T3-1", "dense-rbf", 4.4))
    assert row(evidence, "M3, 3D").met is False
    evidence.results.library["M3-steady"] = figures(50_144, 0.014)
    assert row(evidence, "M3, 3D").met is True
    assert row(evidence, "M4, 3D").measured == "not measured"
    assert row(evidence, "M4: opening").met is True
    assert row(evidence, "M5, 3D").met is False
    assert row(evidence, "W3, 3D").met is None
    assert row(evidence, "step ~ nodes").met is False  # 357 times the time for 97 times the nodes
    assert row(evidence, "M5: largest memory").measured == "4.1 GB"
    assert row(evidence, "M3: later iteration / first").met is True
    assert row(evidence, "M4: share of the wire").met is False
    assert row(evidence, "M4: worker's memory").met is True
    assert row(evidence, "M5: bytes per node").measured == "300 at most, 100 kept"
    assert row(evidence, "M3: corrected minimum").met is True
    assert row(evidence, "M3: correction to 0.28").met is False  # 4 s
    assert row(evidence, "M2: correction to the maximum").met is None
    assert row(evidence, "M3: quality next to the body").measured == "97.6 % (0.400 of 0.410)"
    assert row(evidence, "M4: times faster than IDWarp").measured == "109, over the wire"


def test_the_fastest_other_system_counts(evidence: Evidence) -> None:
    assert row(evidence, "M3: times faster than the fastest").met is None
    evidence.outcomes += [
        outcome("M3-T3-1", "dense-rbf", 4.9),
        outcome("M3-T3-1", "kratos-laplacian", 1.2, minimum=-0.9),
        outcome("M3-T3-1", "ours-plain", 0.1),
        replace(outcome("M3-T3-1", "openfoam", 0.1), measurement=None, verdict=None, note="not installed"),
    ]
    found = row(evidence, "M3: times faster than the fastest")
    assert (found.met, found.measured) == (True, "12 (kratos-laplacian)")


@pytest.mark.parametrize("plan", PLANS)
def test_plans_name_what_exists(plan: str) -> None:
    known = {"library": SCALE, "wire": SCALE, "truth": SCALE, "correction": CORRECTIONS, "peer": PEERS, "start": MESHES}
    known["derivative"] = MESHES
    jobs = PLANS[plan]
    for job in jobs:
        assert job.name in known[job.kind], job.text
        assert not job.system or job.system in SYSTEMS, job.text
    assert len({job.text for job in jobs}) == len(jobs)
    assert plan != "quick" or sum(job.seconds for job in jobs) < 180


def test_benchmarks_without_time_are_left_out_and_failures_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, evidence: Evidence
) -> None:
    done = []

    def measure(run: object, job: Job) -> None:
        done.append(job.name)
        if job.name == "bad":
            raise OSError("broken")

    monkeypatch.setitem(command._JOBS, "library", measure)
    run = command._Run(evidence, tmp_path, tmp_path, 1, 1)
    jobs = [Job("library", "good", 1.0), Job("library", "long", 1e6), Job("library", "bad", 1.0)]
    command._go_through(run, jobs, 100.0)
    assert done == ["good", "bad"]
    assert evidence.left_out == ["library long (no time)", "library bad (failed)"]
    assert (tmp_path / "bench.md").exists()
    assert (tmp_path / "bench.json").exists()


def test_a_measurement_that_hangs_is_ended_with_its_children() -> None:
    with pytest.raises(subprocess.TimeoutExpired):
        measured_in_fresh_process("scale.library", 1, "M1-steady", "/nowhere", "1", timeout=0.05)
    with pytest.raises(subprocess.CalledProcessError):
        measured_in_fresh_process("no_such_module", 1)


@pytest.mark.nightly  # processes of their own
def test_a_short_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """A small job of every kind, through the command."""
    cases = {"library": "M1-steady", "wire": "M1-steady", "truth": "M1-large", "correction": "M2-0.20"}
    jobs = [Job(kind, cases.get(kind, "M1"), 30) for kind in command._JOBS if kind != "peer"]
    monkeypatch.setitem(PLANS, "quick", [*jobs, Job("peer", "M1-T1-1", 5, "dense-rbf")])
    words = ["--plan", "quick", "--out", str(tmp_path), "--meshes", str(tmp_path / "meshes"), "--repeat", "1"]
    command.main(words)
    printed = capsys.readouterr().out
    assert "(failed)" not in printed
    assert "(no time)" not in printed
    assert "| M1 steady | 723 | 104 |" in printed
    assert "| dense RBF in numpy, all centres |" in printed
    assert (tmp_path / "scale.png").read_bytes().startswith(b"\x89PNG")
