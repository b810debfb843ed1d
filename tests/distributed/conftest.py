"""Clusters of worker processes on this machine."""

from collections.abc import Iterator
from typing import Any

import pytest
from worker_processes import workers

from tests.faults.server_process import ServerProcess


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    with ServerProcess(tmp_path_factory.mktemp("server")) as running:
        yield running


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    with workers(3) as client:
        yield client


@pytest.fixture
def fragile_cluster() -> Iterator[Any]:
    with workers(2) as client:
        yield client
