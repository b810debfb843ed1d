"""Our server and our client, tested by the conformance suite from outside."""

import pytest

from tests.faults.server_process import ServerProcess

#: Short enough that their end is part of the suite.
SETTINGS = {"lease_seconds": 1.0, "collective_timeout_seconds": 1.0}


@pytest.fixture(scope="module")
def our_server(tmp_path_factory):
    folder = tmp_path_factory.mktemp("conformance")
    with ServerProcess(folder, level="error", **SETTINGS) as server:
        yield server.endpoint
