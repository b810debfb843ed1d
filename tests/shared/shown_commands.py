"""Runs the commands that a page of the documentation shows."""

import os
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def blocks(page: str, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", page, re.DOTALL)


def run(script: str, folder: Path, client: str) -> subprocess.CompletedProcess[str]:
    """Run a shell script in a folder with ``mesh-motion`` as a command, the examples and client.py."""
    program = folder / "bin" / "mesh-motion"
    program.parent.mkdir()
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -m mesh_motion_server "$@"\n')
    program.chmod(0o755)
    (folder / "examples").symlink_to(ROOT / "examples")
    (folder / "client.py").write_text(client)
    return subprocess.run(
        ["sh", "-c", script],
        cwd=folder,
        env=os.environ | {"PATH": f"{program.parent}:{os.environ['PATH']}"},
        capture_output=True,
        text=True,
        timeout=280,
        check=False,
    )
