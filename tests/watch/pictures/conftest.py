"""Folders like those of ``mesh-motion play``: a flag's history, and tiny meshes that move."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from tiny_meshes import tiny_mesh

from mesh_motion_server.cases.outputs import write_steps
from mesh_motion_server.cases.records import StepRecord
from mesh_motion_server.files import VtuSeries

MakePlayed = Callable[..., Path]


def records(count: int) -> list[StepRecord]:
    """A run whose quality rises and falls, lowest in step 3 at 0.05, corrected where it would be below 0.2."""
    plain = [0.5 - 0.1 * (n % 5) if n != 3 else 0.05 for n in range(1, count + 1)]
    return [
        StepRecord(
            **dict.fromkeys(StepRecord.columns(), 0.0)  # type: ignore[arg-type]
            | {
                "step": n,
                "min_size_skew": value,
                "min_skew": value + 0.1,
                "min_size": value + 0.2,
                "mean_size_skew": 0.9,
                "predicted_min": value,
                "predicted_standard": value - 0.3 if n % 2 else value,
                "iterations": 1 + n % 3,
                "enrichment_points": n % 4,
                "seconds": 0.02,
                "seconds_solve": 0.5 if n == 1 else 0.004,
                "seconds_correct": 0.002,
            }
        )
        for n, value in enumerate(plain, start=1)
    ]


@pytest.fixture
def played(tmp_path: Path) -> MakePlayed:
    """Make a folder: its name, the steps, and the tiny mesh of its series, if it has one."""

    def make(name: str = "flag", steps: int = 12, mesh: str | None = None) -> Path:
        folder = tmp_path / name
        folder.mkdir()
        write_steps(folder, records(steps))
        summary = {
            "case": f"cases/{name}/case.toml",
            "method": {"quality_metric": "size-skew", "quality_threshold": 0.2},
        }
        (folder / "summary.json").write_text(json.dumps(summary))
        if mesh is not None:
            points, cells = tiny_mesh(mesh)
            series = VtuSeries(folder, "mesh")
            for step in range(steps + 1):
                moved = points.copy()
                moved[points[:, 0] == 0.0, 0] -= 0.02 * step
                series.write(float(step), moved, cells)
        return folder

    return make
