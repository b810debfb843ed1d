"""Our server and our client as the conformance suite meets them: from outside."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
LIFELINE = "MESH_MOTION_LIFELINE_FD"
#: Short enough that their end is part of the suite.
SETTINGS = 'lease_seconds = 1.0\ncollective_timeout_seconds = 1.0\nthreads = 1\nendpoint = "tcp://127.0.0.1:0"\n'


@pytest.fixture(scope="session")
def python_path():
    """For programs that the tests start: the suite may not be installed yet."""
    return os.pathsep.join([*map(str, (ROOT / "protocol" / "conformance",)), *sys.path])


@pytest.fixture(scope="module")
def our_server(tmp_path_factory):
    """The endpoint of our server, as it is installed."""
    folder = tmp_path_factory.mktemp("conformance")
    ready = folder / "ready.json"
    (folder / "settings.toml").write_text(SETTINGS)
    arguments = ["--state", folder / "state", "--ready-file", ready, "--settings", folder / "settings.toml"]
    lifeline, ours = os.pipe()  # the server ends with the tests, even if they are killed
    with (folder / "log").open("wb") as log:
        process = subprocess.Popen(
            [sys.executable, "-m", "mesh_motion_server", "serve", "--log-level", "error", *map(str, arguments)],
            env=os.environ | {LIFELINE: str(lifeline)},
            pass_fds=[lifeline],
            stdout=subprocess.DEVNULL,
            stderr=log,
        )
    os.close(lifeline)
    deadline = time.monotonic() + 60
    while not ready.exists():
        assert process.poll() is None, (folder / "log").read_text()
        assert time.monotonic() < deadline, "the server is not ready"
        time.sleep(0.02)
    yield json.loads(ready.read_text())["endpoint"]
    process.terminate()
    process.wait(30)
    os.close(ours)
