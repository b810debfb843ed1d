"""Servers, and small file systems."""

import contextlib
import os
import subprocess

import pytest
from served import Served


@pytest.fixture
def serve(tmp_path):
    servers = []

    def start(**settings):
        servers.append(Served(tmp_path / f"server{len(servers)}", **settings))
        return servers[-1].start()

    yield start
    for server in servers:
        server.stop()


@pytest.fixture
def small_disk(tmp_path):
    """Mounts a file system of this size in bytes; skipped if that is not allowed."""
    with contextlib.ExitStack() as mounted:

        def mount(size):
            folder = tmp_path / "disk"
            folder.mkdir()
            command = ["mount", "-t", "tmpfs", "-o", f"size={size},mode=0700", "none", str(folder)]
            if os.geteuid() != 0 or subprocess.run(command, check=False, capture_output=True).returncode != 0:
                pytest.skip("a file system of its own needs root")
            mounted.callback(subprocess.run, ["umount", "-l", str(folder)], check=True)
            return folder

        yield mount
