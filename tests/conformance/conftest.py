"""Our server and our client, tested by the conformance suite from outside."""

import os
import sys
from pathlib import Path

import pytest

from tests.faults.server_process import ServerProcess

ROOT = Path(__file__).resolve().parents[2]
#: Short enough that their end is part of the suite.
SETTINGS = {"lease_seconds": 1.0, "collective_timeout_seconds": 1.0}


@pytest.fixture(scope="session")
def python_path():
    return os.pathsep.join([*map(str, (ROOT / "protocol" / "conformance",)), *sys.path])


@pytest.fixture(scope="module")
def our_server(tmp_path_factory):
    folder = tmp_path_factory.mktemp("conformance")
    with ServerProcess(folder, level="error", **SETTINGS) as server:
        yield server.endpoint
