"""The cost of the monitor page for a step: ``python -m benchmarks.monitor_page [--side N] [--browsers N] [--pairs N]``.

One session of a real server makes steps, each a Move and a commit of a mesh of triangles. For blocks of some seconds,
browsers send the page's requests: the list every second, the session and its series every two seconds, its mesh every
three; in the blocks in between no browser sends requests. The medians of neighbouring blocks are compared pair by pair.
The processor time of the page's process is measured too: if other cores are free, this process does not slow the step.
"""

from __future__ import annotations

import argparse
import http.client
import json
import os
import statistics
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
from mesh_motion_client import Mesh, Patch, connect

from tests.faults.processes import children_of, name_of
from tests.faults.server_process import ServerProcess
from tests.faults.stand_in import grid_mesh

__all__ = ["main"]

_BLOCK_SECONDS = 8.0
#: The requests of the page, and the shortest time between two of them.
_SECONDS = {"": 1.0, "/{}": 2.0, "/{}/series?points=1500": 2.0, "/{}/mesh.png": 3.0}
_TICK = os.sysconf("SC_CLK_TCK")


class _Browser(threading.Thread):
    """A browser that requests the page until it is stopped."""

    def __init__(self, address: str, session: str) -> None:
        super().__init__(daemon=True)
        self._address, self._session = address, session
        self._over = threading.Event()

    def run(self) -> None:
        asked = http.client.HTTPConnection(self._address, timeout=60)
        due = dict.fromkeys(_SECONDS, 0.0)
        while not self._over.wait(0.1):
            for path, seconds in _SECONDS.items():
                if time.monotonic() >= due[path]:
                    due[path] = time.monotonic() + seconds
                    asked.request("GET", "/api/sessions" + path.format(self._session))
                    asked.getresponse().read()
        asked.close()

    def stop(self) -> None:
        """At the next question."""
        self._over.set()


def _processor_seconds(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / _TICK


def _block(session: Any, rows: Any, steps: int) -> list[float]:
    """Seconds of each step of a block: at least a given number of steps, and at least some seconds in total."""
    taken: list[float] = []
    end = time.monotonic() + _BLOCK_SECONDS
    while time.monotonic() < end or len(taken) < steps:
        started = time.perf_counter()
        session.move(rows * (1 + 0.1 * np.sin(0.1 * session.step)))
        session.commit()
        taken.append(time.perf_counter() - started)
    return taken


def measure(folder: Path, side: int, browsers: int, pairs: int) -> dict[str, float]:
    """Medians in milliseconds, the ratio of pairs, and shares of a core."""
    part = grid_mesh(side)
    patches = {name: Patch(patch.role, patch.nodes) for name, patch in part.patches.items()}
    mesh = Mesh(part.points, {"triangle": np.asarray(part.cells["triangle"])}, patches)
    settings = {"support_radius": 0.5, "correction": "none", "displacement": "absolute", "allow_invalid": True}
    with ServerProcess(folder, monitor="127.0.0.1:0") as server, connect(server.endpoint) as client:
        address = server.announced["monitor"].removeprefix("tcp://")
        (page,) = [pid for pid in children_of(server.process.pid) if name_of(pid) == "mesh-page"]
        session = client.open(mesh, settings, label="measured")
        rows = np.full((len(session.moving_nodes), 2), 0.02)
        _block(session, rows, 20)
        asked = http.client.HTTPConnection(address)
        asked.request("GET", "/api/sessions")
        (listed,) = json.load(asked.getresponse())["sessions"]
        ratios, seen, unseen, shares, idle = (list[float]() for _ in range(5))
        for _ in range(pairs):
            for look in (True, False):
                lookers = [_Browser(address, listed["session"]) for _ in range(browsers if look else 0)]
                for one in lookers:
                    one.start()
                before, began = _processor_seconds(page), time.monotonic()
                taken = _block(session, rows, 20)
                (shares if look else idle).append((_processor_seconds(page) - before) / (time.monotonic() - began))
                (seen if look else unseen).append(statistics.median(taken))
                for one in lookers:
                    one.stop()
                for one in lookers:
                    one.join(30)
            ratios.append(seen[-1] / unseen[-1])
        session.close("discard")
    return {
        "step_ms": 1000 * statistics.median(unseen),
        "watched_ms": 1000 * statistics.median(seen),
        "ratio": statistics.median(ratios),
        "page_share": statistics.median(shares),
        "page_share_unwatched": statistics.median(idle),
    }


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--side", type=int, default=120, help="nodes along a side of the mesh")
    parser.add_argument("--browsers", type=int, default=3)
    parser.add_argument("--pairs", type=int, default=9, help="pairs of blocks, one watched and one not")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        found = measure(Path(folder), asked.side, asked.browsers, asked.pairs)
    sys.stdout.write(
        f"{asked.side**2} nodes, {asked.browsers} browsers, {asked.pairs} pairs of blocks\n"
        f"step, page closed {found['step_ms']:8.1f} ms\n"
        f"step, watched      {found['watched_ms']:8.1f} ms\n"
        f"ratio of pairs     {found['ratio']:8.3f}\n"
        f"page's process     {found['page_share']:8.3f} of a core watched, {found['page_share_unwatched']:.3f} not\n"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
