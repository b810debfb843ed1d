"""The benchmark of the correction's cost: one small case end to end, and the page it fills."""

import math
from pathlib import Path

import pytest

from benchmarks.correction.cases import CASES, Case
from benchmarks.correction.cost import Cost, measured
from benchmarks.correction.report import README, fill, table


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("meshes")


@pytest.mark.parametrize("target", [0.2, math.inf])
def test_a_case_is_measured(folder: Path, target: float) -> None:
    cost = measured(Case("M1", "T1", target), folder, repeat=1)
    assert cost.standard < 0.2 <= cost.minimum
    assert 0 < cost.freed <= cost.free < cost.nodes
    assert (cost.freed == cost.free) == math.isinf(target)
    assert cost.iterations > 5
    assert cost.limit_cpu_seconds > 0
    assert cost.peak_bytes > 1e7


def test_the_table_takes_its_place(tmp_path: Path) -> None:
    page = tmp_path / "README.md"
    page.write_text("before\n<!-- benchmark: correction -->\nold\n<!-- end -->\nafter\n")
    cost = Cost(50144, 44263, 600, 0.108, 0.2008, 6, 0.1, 0.08, 0.04, 250_000_000)
    fill(table({"M3-0.20": cost}, "A machine."), page)
    lines = page.read_text().splitlines()
    assert (lines[0], lines[-1]) == ("before", "after")
    assert "| M3 T3 | 50144 | 0.20 | 0.108 | 0.201 | 600 | 6 | 0.1 | 0.08 | 2 | 2.0 | 250 |" in lines
    assert "old" not in lines


def test_a_page_without_a_place_is_refused(tmp_path: Path) -> None:
    (tmp_path / "README.md").write_text("nothing\n")
    with pytest.raises(ValueError, match="benchmark: correction"):
        fill("text", tmp_path / "README.md")


def test_the_readme_shows_every_case_that_has_a_time() -> None:
    text = README.read_text(encoding="utf-8")
    for case in CASES.values():
        assert case.seconds is None or f"| {case.mesh} {case.motion} |" in text
