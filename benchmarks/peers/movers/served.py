"""The mesh-motion server over its network connection: the time that a solver waits.

The server is started and its kernels are loaded before the clock starts; set-up is opening a session and sending the
mesh, a step is one or more Moves and one durable Commit. Memory and processor time are those of client, server and
workers together.
"""

from __future__ import annotations

import atexit
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from mesh_motion_client import Mesh, Patch, Server, connect
from numpy.typing import NDArray

from benchmarks.peers.measurement import cpu_seconds
from benchmarks.peers.movers.small_task import small_task
from benchmarks.peers.task import Task

__all__ = ["ServedMover", "await_rest"]

_RELAXATION = 0.2  # what is left of a step's displacement shrinks by this factor in each coupling iteration
_POLL = 2.0  # seconds
_RESTING = 0.05  # share of a core
_READY_TIMEOUT = 120.0


class ServedMover:
    """A session on a private server.

    Parameters
    ----------
    iterations : int
        Coupling iterations of each step: Moves from the same committed state, each with another displacement.
    **options
        The session's settings.
    """

    server: ClassVar[Server]

    def __init__(self, task: Task, *, iterations: int = 1, **options: Any) -> None:
        patches = {"moving": Patch("moving", task.moving), "fixed": Patch("fixed", task.fixed)}
        self.task = task
        self.iterations = iterations
        self.session = self.server.open(Mesh(task.points, cells=task.cells, patches=patches), options)
        self.order = np.searchsorted(task.moving, self.session.moving_nodes)

    def move(self, step: int) -> NDArray[np.float64]:
        """Positions after a step, committed."""
        displacement = self.task.displacements[step][self.order]
        for iteration in range(1, self.iterations):
            before = self.task.displacements[step - 1][self.order] if step else 0.0 * displacement
            share = 1 - _RELAXATION**iteration
            self.session.move(before + share * (displacement - before))
        moved = self.session.move(displacement)
        self.session.commit()
        positions: NDArray[np.float64] = self.task.points + moved.displacement
        return positions

    @classmethod
    def prepare(cls, task: Task, options: Mapping[str, Any]) -> None:
        """Start the server and wait until it has loaded its kernels."""
        cls.server = connect(_start_server(), compute_timeout=3600.0)
        small = cls(small_task(task), **{**options, "quality_threshold": 0.99})
        small.move(0)
        small.session.close("discard")
        await_rest()


def _start_server() -> str:
    """Endpoint of a server that has as many threads as this process and ends with this process."""
    folder = tempfile.TemporaryDirectory(prefix="peers-")
    ready = Path(folder.name) / "ready.json"
    options = ["--threads", os.environ.get("MESH_MOTION_THREADS", "0"), "--ready-file", str(ready)]
    options += ["--endpoint", f"ipc://{folder.name}/control", "--state", f"{folder.name}/state"]
    process = subprocess.Popen(
        [sys.executable, "-m", "mesh_motion_server", "serve", "--log-level", "error", *options],
        stdout=subprocess.DEVNULL,
    )
    atexit.register(folder.cleanup)
    atexit.register(process.wait)
    atexit.register(process.terminate)  # the last one registered is called first
    deadline = time.monotonic() + _READY_TIMEOUT
    while not ready.exists():
        if process.poll() is not None or time.monotonic() > deadline:
            raise RuntimeError("the server did not become ready; its words are above")
        time.sleep(0.02)
    return str(json.loads(ready.read_text(encoding="utf-8"))["endpoint"])


def await_rest() -> None:
    """Wait until the server's next worker is ready: its processes then use no more processor time."""
    used, deadline = -1.0, time.monotonic() + _READY_TIMEOUT
    while (now := cpu_seconds(os.getpid())) - used > _RESTING * _POLL and time.monotonic() < deadline:
        used = now
        time.sleep(_POLL)
