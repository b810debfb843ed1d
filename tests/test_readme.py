"""The commands of the README are run."""

from pathlib import Path

from python_runs import said_by_python
from shown_commands import blocks

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_ten_lines_of_client_run() -> None:
    (script, *_) = blocks(README, "python")
    assert float(said_by_python("-c", script, cwd=ROOT, timeout=120).split()[0]) > 0.2
