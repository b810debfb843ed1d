"""``connect()`` without an endpoint: a private server that never outlives its client."""

import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest
from mesh_motion_client import Unavailable, connect, embedded

CLIENT = """
import time
from mesh_motion_client import connect
server = connect()
print(server._embedded.process.pid, flush=True)
time.sleep(600)
"""


def gone(pid):
    deadline = time.monotonic() + 30
    while Path(f"/proc/{pid}").exists() and Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z":
        assert time.monotonic() < deadline
        time.sleep(0.02)
    return True


def test_it_answers_and_ends_with_the_connection():
    with connect() as server:
        assert server.endpoint.startswith("ipc://")
        assert server.sessions() == []
        embedded = server._embedded
    assert embedded.process.poll() == 0
    assert not Path(server.endpoint.removeprefix("ipc://")).parent.exists()


def test_kill_9_of_the_client_ends_it():
    with subprocess.Popen([sys.executable, "-c", CLIENT], stdout=subprocess.PIPE, text=True) as client:
        pid = int(client.stdout.readline())
        os.kill(client.pid, signal.SIGKILL)
    assert gone(pid)


def test_a_temporary_folder_with_a_long_path_is_not_used_for_sockets(tmp_path, monkeypatch):
    deep = tmp_path / ("x" * 100)
    deep.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(deep))
    with connect() as server:
        assert server.sessions() == []


def test_a_server_that_cannot_start_says_why(tmp_path, monkeypatch):
    deep = tmp_path / ("x" * 100)
    deep.mkdir()
    monkeypatch.setattr(embedded, "_short_folder", lambda: str(deep))
    with pytest.raises(Unavailable, match=r"did not become ready: an ipc path must leave room in 107 bytes") as refusal:
        connect()
    assert refusal.value.hint == "set TMPDIR to a folder with a shorter path"


@pytest.mark.parametrize("closed", [(0,), (1,), (2,), (0, 1, 2)])
def test_it_starts_where_standard_descriptors_are_closed(closed, tmp_path):
    """As of a job of cron, a daemon, or an MPI rank."""
    said = tmp_path / "said"
    code = f"""
import os
for descriptor in {closed}:
    os.close(descriptor)
from mesh_motion_client import connect
with connect() as server:
    open({str(said)!r}, "w").write(server.endpoint)
"""
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)
    assert said.read_text().startswith("ipc://")


@pytest.mark.parametrize("closed", [(0,), (1,), (2,), (0, 1, 2)])
def test_commands_run_where_standard_descriptors_are_closed(closed):
    code = f"""
import os, sys
for descriptor in {closed}:
    os.close(descriptor)
os.execv(sys.executable, [sys.executable, "-m", "mesh_motion_server", "version"])
"""
    assert subprocess.run([sys.executable, "-c", code], timeout=60, check=False).returncode == 0


FORKED = """
import os, sys
from mesh_motion_client import MeshMotionError, connect
with connect() as server:
    child = os.fork()
    if not child:
        try:
            server.sessions()
        except MeshMotionError as error:
            print(error, flush=True)
        server.close()
        sys.exit()
    os.waitpid(child, 0)
    print("parent", server.sessions(), os.path.isdir(os.path.dirname(server.endpoint.removeprefix("ipc://"))))
"""


def test_a_forked_child_is_refused_and_leaves_its_parent_the_server():
    done = subprocess.run([sys.executable, "-c", FORKED], capture_output=True, text=True, timeout=60, check=True)
    refused, parent = done.stdout.splitlines()
    assert "forked from it" in refused
    assert "connect in the child" in refused
    assert parent == "parent [] True"
