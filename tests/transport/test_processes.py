"""What a child of the supervisor starts with."""

import os
from pathlib import Path

import pytest

from mesh_motion_server.transport.processes import spawn

MODULE = """
import os, sys
from mesh_motion_server.transport.channel import Channel
Channel.inherited(int(sys.argv[1])).send({"names": {name: os.environ.get(name, "") for name in sys.argv[2:]}})
"""


def environment(folder: Path, *names: str) -> dict[str, str]:
    (folder / "says_environment.py").write_text(MODULE, encoding="utf-8")
    child = spawn("says_environment", *names, threads=1)
    told = child.channel.receive()
    child.reap()
    assert told is not None
    values: dict[str, str] = told["names"]
    return values


def test_the_threads_of_loops_and_of_blas_are_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}{os.pathsep}{os.environ.get('PYTHONPATH', '')}")
    told = environment(tmp_path, "MESH_MOTION_THREADS", "OPENBLAS_NUM_THREADS")
    assert told == {"MESH_MOTION_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
