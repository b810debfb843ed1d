"""What the README shows is run."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from pathlib import Path

from mesh_motion_server.cases.case import read_case
from tools.monitor_picture import MOST_BYTES

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def block(language: str) -> str:
    found = re.search(rf"```{language}\n(.*?)```", README, re.DOTALL)
    assert found is not None
    return found.group(1)


def test_the_ten_lines_of_client_run() -> None:
    run = subprocess.run(
        [sys.executable, "-c", block("python")], cwd=ROOT, capture_output=True, text=True, timeout=120, check=False
    )
    assert run.returncode == 0, run.stderr
    assert float(run.stdout.split()[0]) > 0.2


def test_the_case_file_is_one(tmp_path: Path) -> None:
    text = block("toml")
    assert tomllib.loads(text)["patches"] == {"block": "moving", "outer": "fixed"}
    (tmp_path / "case.toml").write_text(text, encoding="utf-8")
    (tmp_path / "mesh.npz").write_bytes((ROOT / "examples" / "thesis_rotation" / "mesh.npz").read_bytes())
    case = read_case(tmp_path / "case.toml")
    assert case.content.method.quality_threshold == 0.2


def test_every_link_leads_somewhere() -> None:
    links = re.findall(r"\]\((?!https?:)([^)#]+)\)", README)
    assert len(links) > 8
    assert [link for link in links if not (ROOT / link).exists()] == []


def test_pictures_are_small() -> None:
    pictures = re.findall(r"!\[[^]]+\]\((docs/images/[^)]+)\)", README)
    assert "docs/images/monitor.png" in pictures
    assert (ROOT / "docs/images/monitor.png").stat().st_size <= MOST_BYTES
