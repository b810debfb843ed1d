"""What the README shows is run."""

import subprocess
import sys
from pathlib import Path

from shown_commands import blocks

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_ten_lines_of_client_run() -> None:
    run = subprocess.run(
        [sys.executable, "-c", blocks(README, "python")[0]],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    assert float(run.stdout.split()[0]) > 0.2
