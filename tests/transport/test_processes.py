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


def test_threads_sleep_while_they_wait_unless_told_otherwise(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    name = "OMP_WAIT_POLICY"
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}{os.pathsep}{os.environ.get('PYTHONPATH', '')}")
    monkeypatch.delenv(name, raising=False)
    assert environment(tmp_path, name)[name] == "passive"
    monkeypatch.setenv(name, "active")
    assert environment(tmp_path, name)[name] == "active"
