"""Clusters of worker processes on this machine, and the meshes of the tests of numerics."""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1] / "numerics")]

from worker_processes import workers  # noqa: E402

from tests.faults.server_process import ServerProcess  # noqa: E402


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
