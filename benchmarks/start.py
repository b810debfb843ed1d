"""The cost of a start: ``python -m benchmarks.start MESH FOLDER REPEAT`` prints JSON.

Measures what a user waits for: the command's help, a server until it is ready, ``connect()`` and opening the mesh in a
program, the memory of a small session's process, and one step of 22 000 nodes without a correction, played from a case
file with pictures and VTU files.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from mesh_motion_client import Mesh, Patch, connect

from benchmarks.peers.measurement import cpu_seconds, resident_by_process
from benchmarks.peers.meshes import BenchmarkMesh, load_or_build
from benchmarks.scale.figures import Seconds, StartFigures

__all__ = ["measured"]

_COMMAND = [sys.executable, "-m", "mesh_motion_server"]
_PLAYED, _SMALL = "M8", "M1"
_CASE = """
[mesh]
file = "mesh.npz"
[patches]
body = "moving"
box = "fixed"
[[motion]]
patch = "body"
rigid = { translation = [-0.01, -0.01], rotation = 2.0, centre = [0.5, 0.5] }
[steps]
count = 1
"""


def measured(mesh: str, folder: Path, repeat: int) -> StartFigures:
    """The shortest of ``repeat`` times; the opened mesh is one of :mod:`.peers.meshes`."""
    opened = load_or_build(mesh, folder)
    with tempfile.TemporaryDirectory() as name:
        case = _case(load_or_build(_PLAYED, folder), Path(name))
        return StartFigures(
            help=_shortest(repeat, lambda: _run(["--help"])),
            ready=_shortest(repeat, _until_ready),
            opened=_shortest(repeat, lambda: _opened(opened)),
            worker_bytes=_worker_of(load_or_build(_SMALL, folder)),
            played=_shortest(repeat, lambda: _run(["play", str(case), "-o", f"{name}/out", "-q"])),
        )


def _shortest(repeat: int, task: Callable[[], Seconds]) -> Seconds:
    return Seconds.shortest([task() for _ in range(repeat)])


def _run(words: list[str]) -> Seconds:
    """Times of a command, with all processes that it waits for."""
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run([*_COMMAND, *words], check=True, stdout=subprocess.DEVNULL)
    wall, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    return Seconds(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, wall)


def _until_ready() -> Seconds:
    """Times of a server until it reports that it is ready."""
    with tempfile.TemporaryDirectory() as folder:
        words = ["serve", "--endpoint", f"ipc://{folder}/control", "--state", f"{folder}/state", "--log-level", "error"]
        began = time.perf_counter()
        with subprocess.Popen([*_COMMAND, *words], stdout=subprocess.PIPE, text=True) as server:
            assert server.stdout is not None
            line = server.stdout.readline()
            found = Seconds(cpu_seconds(server.pid), time.perf_counter() - began)
            server.terminate()
        if not line.startswith("ready"):
            raise RuntimeError("the server did not become ready; its words are above")
        return found


def _opened(mesh: BenchmarkMesh) -> Seconds:
    """A private server and a session with the mesh, from a program that has loaded the client."""
    used, began = cpu_seconds(os.getpid()), time.perf_counter()
    with connect() as server, server.open(_given(mesh)) as session:
        found = Seconds(cpu_seconds(os.getpid()) - used, time.perf_counter() - began)
        session.close("discard")
    return found


def _worker_of(mesh: BenchmarkMesh) -> int:
    """Resident bytes of the process of a session that has moved once."""
    with connect() as server:
        server.sessions()
        before = resident_by_process(os.getpid())
        with server.open(_given(mesh)) as session:
            session.move(np.full((len(session.moving_nodes), mesh.points.shape[1]), 1e-3))
            found = resident_by_process(os.getpid())
            session.close("discard")
    workers = [size for process, size in found.items() if process != os.getpid() and size != before.get(process)]
    return max(workers)


def _given(mesh: BenchmarkMesh) -> Mesh:
    patches = {"body": Patch("moving", mesh.moving), "box": Patch("fixed", mesh.fixed)}
    return Mesh(mesh.points, cells=mesh.cells, patches=patches)


def _case(mesh: BenchmarkMesh, folder: Path) -> Path:
    """The case file."""
    cells: dict[str, Any] = {f"cells_{kind}": np.asarray(nodes, dtype=np.int64) for kind, nodes in mesh.cells.items()}
    np.savez(folder / "mesh.npz", points=mesh.points, patch_body=mesh.moving, patch_box=mesh.fixed, **cells)
    path = folder / "case.toml"
    path.write_text(_CASE, encoding="utf-8")
    return path


def main(arguments: list[str]) -> None:
    """Run the command line that the module's docstring describes."""
    mesh, folder, repeat = arguments
    print(json.dumps(asdict(measured(mesh, Path(folder), int(repeat)))))


if __name__ == "__main__":
    main(sys.argv[1:])
