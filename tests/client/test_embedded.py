"""``connect()`` without an endpoint: a private server that never outlives its client."""

import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
from mesh_motion_client import Unavailable, connect

from tests.faults.processes import alive
from tests.faults.waiting import wait_until

CLIENT = """
import time
from mesh_motion_client import connect
server = connect()
print(server._embedded.process.pid, server.endpoint.removeprefix("ipc://"), flush=True)
time.sleep(600)
"""


def test_it_answers_and_ends_with_the_connection():
    with connect() as server:
        assert server.endpoint.startswith("ipc://")
        assert server.sessions() == []
        embedded = server._embedded
    assert embedded.process.poll() == 0
    assert not Path(server.endpoint.removeprefix("ipc://")).parent.exists()


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_it_ends_with_a_killed_client_and_leaves_nothing(tmp_path, number):
    command, environment = [sys.executable, "-c", CLIENT], os.environ | {"TMPDIR": str(tmp_path)}
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as client:
        pid, socket = client.stdout.readline().split()
        os.kill(client.pid, number)
    wait_until(lambda: not alive(int(pid)), "the server has ended with its client")
    assert not list(tmp_path.iterdir())
    assert not Path(socket).parent.exists()


def test_a_server_that_cannot_start_says_why(tmp_path):
    with pytest.raises(Unavailable) as refused:
        connect(server_options=["--endpoint", "tcp://0.0.0.0:0"])
    assert refused.value.message.startswith("the embedded server did not become ready: tcp://0.0.0.0:0 is reached by")
    assert refused.value.hint.startswith("give --keys")
    with pytest.raises(Unavailable, match=r"did not become ready: .*missing.toml: not readable as TOML") as refused:
        connect(server_options=["--settings", str(tmp_path / "missing.toml")])
    assert refused.value.hint == ""


def test_the_folder_for_temporary_files_may_have_a_long_path(tmp_path, monkeypatch):
    """The sockets are then in another folder, the stored data is not."""
    deep = tmp_path / ("x" * 100)
    deep.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(deep))
    with connect() as server:
        assert server.sessions() == []
        (folder,) = deep.iterdir()
        assert not server.endpoint.startswith(f"ipc://{deep}")
    assert not folder.exists()
    assert not Path(server.endpoint.removeprefix("ipc://")).parent.exists()


@pytest.mark.skipif(
    subprocess.run(["sh", "-c", "unshare -m true"], check=False, stderr=subprocess.DEVNULL).returncode != 0,
    reason="needs root",
)
@pytest.mark.parametrize("missing", ["/proc", "/sys", "/dev/shm"])
def test_a_container_may_lack_special_file_systems(missing):
    program = "from mesh_motion_client import connect\nwith connect() as server: print(server.sessions())"
    shell = ["unshare", "-m", "sh", "-c", f'umount -l {missing} && exec "$@"', "sh", sys.executable, "-c", program]
    assert subprocess.run(shell, check=False, capture_output=True, text=True).stdout == "[]\n"


FEW_FILES = """
import resource, sys
from mesh_motion_client import MeshMotionError, connect
resource.setrlimit(resource.RLIMIT_NOFILE, (int(sys.argv[1]),) * 2)
try:
    with connect() as server:
        server.sessions()
except MeshMotionError as error:
    print(error.message, "|", error.hint)
"""


@pytest.mark.parametrize("files", [7, 13, 20])
def test_a_process_that_may_open_few_files_gets_a_reason_and_leaves_nothing(tmp_path, files):
    """There are too few for a process, for a connection, or for a session: the client neither hangs nor fails bare."""
    command, environment = [sys.executable, "-c", FEW_FILES, str(files)], os.environ | {"TMPDIR": str(tmp_path)}
    answer = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=50, check=True)
    assert answer.stdout.endswith("| allow more open files: ulimit -n\n")
    assert not list(tmp_path.iterdir())


def test_without_a_folder_for_temporary_files_the_error_has_the_way_out(monkeypatch):
    monkeypatch.setattr(tempfile, "_get_default_tempdir", lambda: (_ for _ in ()).throw(FileNotFoundError(2, "none")))
    monkeypatch.setattr(tempfile, "tempdir", None)
    with pytest.raises(Unavailable, match="cannot be started") as refused:
        connect()
    assert refused.value.hint == "set TMPDIR to a folder that can be written and has some megabytes left"


def test_no_server_is_left_where_its_ready_file_has_no_room(tmp_path, monkeypatch):
    """The server removes its folder before the client has read the log there."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with pytest.raises(Unavailable, match=r"the ready file .*nowhere/r cannot be written: No such file") as refused:
        connect(server_options=["--ready-file", str(tmp_path / "nowhere" / "r")])
    assert refused.value.hint == "name a file in a folder that exists and can be written"
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("closed", ["0<&-", "1>&-", "2>&-", "0<&- 1>&- 2>&-"])
def test_standard_descriptors_may_be_closed(tmp_path, closed):
    """Client and server do not use the numbers of closed standard streams (cron, daemons, ranks of MPI) for pipes."""
    program = (
        "import sys; from mesh_motion_client import connect\nwith connect() as s: open(sys.argv[1], 'w').write('ok')"
    )
    answer = tmp_path / "answer"
    shell = ["sh", "-c", f'exec "$@" {closed}', "sh", sys.executable, "-c", program, str(answer)]
    assert subprocess.run(shell, check=False, stderr=subprocess.DEVNULL).returncode == 0
    assert answer.read_text() == "ok"
