"""The benchmark of the correction's cost: one small case end to end, and the page it fills."""

import math
from pathlib import Path

import pytest

from benchmarks.correction.cases import Case
from benchmarks.correction.cost import measured


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
