"""Programs that a machine may lack, and their output."""

import shutil
import subprocess
import sys
from typing import Any

import pytest


def need(*tools: str) -> None:
    for tool in tools:
        if shutil.which(tool) is None:
            pytest.skip(f"{tool} is not installed")


def mesh_motion(*arguments: object, **options: Any) -> tuple[int, str, str]:
    """Run the command line in a process without a terminal; return status, output, errors."""
    command = [sys.executable, "-m", "mesh_motion_server", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120, **options)
    return done.returncode, done.stdout, done.stderr


def run(*command: object, **options: Any) -> str:
    """Return the output of a command that must succeed."""
    done = subprocess.run([*map(str, command)], capture_output=True, text=True, check=False, **options)
    assert done.returncode == 0, f"{command}\n{done.stdout[-3000:]}\n{done.stderr[-3000:]}"
    return str(done.stdout)
