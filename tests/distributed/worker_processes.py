"""Dask workers as processes of this machine."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from mesh_motion_server.distributed.connection import Connection


@contextmanager
def worker_processes(count: int) -> Iterator[Any]:
    """A cluster with ``count`` workers of one thread."""
    pytest.importorskip("distributed", reason="pip install 'mesh-motion-server[dask]'")
    from benchmarks.distributed.local_cluster import local_cluster  # noqa: PLC0415

    with local_cluster(count) as cluster:
        yield cluster


@contextmanager
def connected(cluster: Any, patience: float = 10.0) -> Iterator[Connection]:
    """A connection to a cluster of this machine."""
    connection = Connection(cluster.scheduler_address, patience)
    try:
        yield connection
    finally:
        connection.close()
