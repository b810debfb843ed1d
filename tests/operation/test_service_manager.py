"""systemd's protocol: the messages of a server to a service manager, and their times."""

import os
import shutil
import socket
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from mesh_motion_server.operation.service_manager import ServiceManager
from tests.faults.waiting import wait_until

UNIT = Path(__file__).parents[2] / "docs" / "mesh-motion.service"


@pytest.fixture
def manager(tmp_path: Path) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(str(tmp_path / "notify"))
        listener.settimeout(60)
        yield listener


def test_no_manager_listens() -> None:
    ServiceManager("").notify("READY=1")
    ServiceManager("/nowhere/at/all").notify("READY=1")


def test_an_abstract_name_and_no_inheritance() -> None:
    name = f"mesh-motion-test-{os.getpid()}"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind("\0" + name)
        environment = {"NOTIFY_SOCKET": "@" + name, "WATCHDOG_USEC": "1", "WATCHDOG_PID": "2", "HOME": "/"}
        ServiceManager.of_environment(environment).notify("READY=1", "STATUS=fine")
        assert listener.recv(100) == b"READY=1\nSTATUS=fine"
    assert environment == {"HOME": "/"}


def test_a_service_says_ready_lives_and_stops(serve: Any, manager: socket.socket, tmp_path: Path) -> None:
    server = serve(environment={"NOTIFY_SOCKET": str(tmp_path / "notify")})
    said: list[str] = []

    def received(word: str) -> bool:
        said.extend(manager.recv(1000).decode().splitlines())
        return word in said

    wait_until(lambda: received("READY=1"), "ready")
    assert f"MAINPID={server.process.pid}" in said
    wait_until(lambda: received("WATCHDOG=1"), "the loop turns")
    assert any(line.startswith("STATUS=0 sessions") for line in said)
    server.process.terminate()
    wait_until(lambda: received("STOPPING=1"), "stopping")
    assert server.stop() == 0


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd is not installed")
def test_the_unit_is_one(tmp_path: Path) -> None:
    text = UNIT.read_text()
    unit = tmp_path / "mesh-motion.service"
    unit.write_text(text.replace("/opt/mesh-motion/bin/mesh-motion", "/bin/true"))
    run = subprocess.run(["systemd-analyze", "verify", str(unit)], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert "mesh-motion.service" not in run.stderr


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd is not installed")
def test_the_unit_gives_the_server_no_more_than_it_needs() -> None:
    """systemd's own exposure score: 0 is nothing, 10 is everything; the rest is the network, folders and priorities."""
    run = ["systemd-analyze", "security", "--offline=yes", "--threshold=20", str(UNIT)]
    ended = subprocess.run(run, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stdout[-2000:]
