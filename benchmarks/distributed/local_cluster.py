"""Dask workers as processes of this machine."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import dask
from distributed import LocalCluster

__all__ = ["local_cluster"]

_ROOT = Path(__file__).parents[2]
#: Workers import the packages of this checkout, whichever are installed.
_ENVIRONMENT = {
    "PYTHONPATH": os.pathsep.join(str(_ROOT / folder) for folder in (".", "adapters/python")),
    **dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"),
}
#: Set by the workers themselves. Dask sets the others in this process for the moment in which it starts one, and the
#: kernels would take them for its own here.
_OF_WORKERS = {"MESH_MOTION_THREADS": "1"}
_SETTINGS = {"distributed.nanny.pre-spawn-environ": _ENVIRONMENT, "distributed.nanny.environ": _OF_WORKERS}


@contextmanager
def local_cluster(count: int) -> Iterator[Any]:
    """A cluster with ``count`` workers of one thread; Dask's messages about killed workers are suppressed."""
    with dask.config.set(_SETTINGS):
        cluster = LocalCluster(  # type: ignore[no-untyped-call]
            n_workers=count,
            threads_per_worker=1,
            host="127.0.0.1",
            dashboard_address="127.0.0.1:0",
            memory_limit=0,
            silence_logs=logging.CRITICAL,
        )
        try:
            yield cluster
        finally:
            cluster.close(timeout=20)
