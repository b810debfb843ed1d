"""Dask workers as processes of this machine."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest


@contextmanager
def workers(count: int) -> Iterator[Any]:
    """A client of a cluster with ``count`` workers of one thread."""
    distributed = pytest.importorskip("distributed", reason="pip install 'mesh-motion-server[dask]'")
    from benchmarks.distributed.local_cluster import local_cluster  # noqa: PLC0415

    with local_cluster(count) as started, distributed.Client(started, set_as_default=False) as client:
        client.wait_for_workers(count, timeout=180)
        yield client
