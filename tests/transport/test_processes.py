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


@pytest.mark.parametrize(("name", "default"), [("MALLOC_TRIM_THRESHOLD_", "134217728"), ("OMP_WAIT_POLICY", "passive")])
def test_memory_is_kept_and_threads_sleep_unless_told_otherwise(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, default: str
) -> None:
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}{os.pathsep}{os.environ.get('PYTHONPATH', '')}")
    monkeypatch.delenv(name, raising=False)
    assert environment(tmp_path, name)[name] == default
    monkeypatch.setenv(name, "0")
    assert environment(tmp_path, name)[name] == "0"
