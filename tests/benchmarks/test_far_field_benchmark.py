"""The benchmark of the far field: a row for each basis and tolerance, and errors within the bounds it prints."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.far_field.__main__ import BASES, TOLERANCES, main


def test_every_row_keeps_its_bound(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["--sizes", "M6", "--meshes", str(tmp_path), "--most", "400"])
    lines = capsys.readouterr().out.splitlines()
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]
    assert len(rows) == len(BASES) * len(TOLERANCES)
    for row in rows:
        tolerance, bound, error = float(row[5]), float(row[8]), float(row[9])
        assert error <= bound * 1.05 + 1e-12
        assert bound <= tolerance * 1.05
