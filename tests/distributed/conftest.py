"""A cluster of worker processes on this machine, and the meshes of the numerics' tests."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1] / "numerics")]

from worker_processes import worker_processes  # noqa: E402


@pytest.fixture(scope="session")
def cluster() -> Iterator[Any]:
    """Two workers for all tests that do no harm to them."""
    with worker_processes(2) as started:
        yield started


@pytest.fixture(scope="module")
def cluster_of_the_module() -> Iterator[Any]:
    """Two workers at first."""
    with worker_processes(2) as started:
        yield started


@pytest.fixture
def fragile_cluster(cluster_of_the_module: Any) -> Any:
    """Two workers to be killed; whoever was before has been replaced."""
    cluster_of_the_module.scale(2)
    cluster_of_the_module.wait_for_workers(2, timeout=180)
    return cluster_of_the_module
