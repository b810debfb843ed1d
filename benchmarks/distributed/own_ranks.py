"""Steps of a session whose ranks evaluate the field: ``python -m benchmarks.distributed.own_ranks M4``.

Each rank reads the file of its partition, moves its nodes and computes the quality of its cells, with one thread: in a
separate process, or with ``--dask`` in a worker of a Dask cluster. For comparison a session that has the whole mesh
makes the same steps. Prints one row for each case: bytes of a step in each direction between server and all ranks,
seconds, processor time of the busiest rank, and the session's memory. With ``--corrected 0.25`` each step turns the
body so far that cells are below that size-skew and are corrected; the row then also has the number of nodes that the
ranks send and the number of freed nodes.
"""

from __future__ import annotations

import argparse
import functools
import multiprocessing
import os
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from mesh_motion_client import Credentials, Mesh, connect
from mesh_motion_client.dask_ranks import open_on_workers

from benchmarks.distributed.use import BYTES, count_bytes, peak_memory, spent
from benchmarks.peers.meshes import load_or_build
from benchmarks.peers.motions import MOTIONS
from mesh_motion_server.files.mesh_file import MeshFile
from mesh_motion_server.files.partitions import write_partitions

__all__ = ["measured"]

SETTINGS = {"displacement": "absolute", "correction": "none", "sub_steps": "never"}
ROLES = {"body": "moving", "box": "fixed"}
STEPS = 4


def _settings(threshold: float) -> dict[str, Any]:
    corrected = {"correction": "optimised", "correction_target": "threshold", "quality_metric": "size-skew"}
    return SETTINGS | (corrected | {"quality_threshold": threshold} if threshold else {})


def _motion(body: Any, step: int, threshold: float) -> Any:
    """Displacement of the body's nodes (k, d): a small one, or one that leaves bad cells."""
    if not threshold:
        return 0.003 * np.sin(3.0 * body[:, ::-1] + step)
    return MOTIONS["T3"].displacements(body, 1)[-1] * (1.0 - 0.001 * step)


def _rank(endpoint: str, file: Path, rank: int, ranks: int, evaluation: str, threshold: float, lines: Any) -> None:
    """Open or join, make some steps, and report their cost."""
    count_bytes()
    mesh = Mesh.load(file, ROLES)
    with connect(endpoint) as server:
        began = time.perf_counter()
        if rank == 0:

            def announce(credentials: Credentials) -> None:
                for line in lines[1:ranks]:
                    line.put(credentials)

            session = server.open(
                mesh, _settings(threshold), partitions=ranks, evaluation=evaluation, announce=announce
            )
        else:
            session = server.join(lines[rank].get(), mesh, partition=rank)
        opened, steps, work, used = time.perf_counter() - began, [], [], []
        with session:
            body = mesh.points[session.moving_nodes]
            for step in range(1, STEPS + 1):
                before, began, begun = Counter(BYTES), time.perf_counter(), time.process_time()
                moved = session.move(_motion(body, step, threshold))
                session.commit()
                steps.append(time.perf_counter() - began)
                work.append(time.process_time() - begun)
                used.append(BYTES - before)
            memory = session.status().report["peak_memory_bytes"]
        row = {"opened": opened, "step": min(steps[1:]), "work": min(work[1:]), "memory": memory}
        row |= {"freed": moved.correction["freed_nodes"], "reached": moved.quality["corrected"]["size_skew"]["min"]}
        lines[-1].put(row | {name: used[-1][name] for name in ("sent", "received", "corrected")})


def _on_ranks(files: Sequence[Path], evaluation: str, threshold: float) -> list[dict[str, float]]:
    """The report of each rank; each rank is a process."""
    context = multiprocessing.get_context("spawn")
    with connect(server_options=["--threads", "1"]) as server:
        lines = [context.Queue() for _ in range(len(files) + 1)]
        arguments = [
            (server.endpoint, file, rank, len(files), evaluation, threshold, lines) for rank, file in enumerate(files)
        ]
        processes = [context.Process(target=_rank, args=given) for given in arguments]
        for process in processes:
            process.start()
        found = [lines[-1].get() for _ in processes]
        for process in processes:
            process.join()
    return found


def _on_workers(files: Sequence[Path], threshold: float) -> list[dict[str, float]]:
    """The report of each rank; the ranks are workers of a Dask cluster."""
    from distributed import Client  # noqa: PLC0415  # an extra

    from benchmarks.distributed.local_cluster import local_cluster  # noqa: PLC0415

    with (
        connect(server_options=["--threads", "1"]) as server,
        local_cluster(len(files)) as started,
        Client(started) as cluster,  # type: ignore[no-untyped-call]
    ):
        cluster.wait_for_workers(len(files))
        cluster.run(count_bytes)
        began = time.perf_counter()
        with open_on_workers(server.endpoint, cluster, files, ROLES, _settings(threshold)) as session:
            opened, found = time.perf_counter() - began, []
            for step in range(1, STEPS + 1):
                before, began = cluster.run(spent), time.perf_counter()
                moved = session.move(functools.partial(_motion, step=step, threshold=threshold))
                session.commit()
                seconds, after = time.perf_counter() - began, cluster.run(spent)
                used = [{name: after[one][name] - before[one][name] for name in after[one]} for one in after]
                found.append([one | {"step": seconds} for one in used])
            memory = cluster.run(peak_memory, workers=session.workers[:1])[session.workers[0]]
    whole = {"opened": opened, "memory": memory, "step": min(one[0]["step"] for one in found[1:])}
    whole |= {"freed": moved.correction["freed_nodes"], "reached": moved.quality["corrected"]["size_skew"]["min"]}
    works = [min(one["work"] for one in of) for of in zip(*found[1:], strict=True)]
    return [one | whole | {"work": work} for one, work in zip(found[-1], works, strict=True)]


def measured(mesh: MeshFile, ranks: int, volume: str, threshold: float = 0.0) -> dict[str, float]:
    """The figures of one case, those of all ranks combined.

    Parameters
    ----------
    mesh : MeshFile
        With patches ``body`` and ``box``.
    volume : {"server", "client", "dask"}
        Owner of the volume mesh: the server (with one rank), ranks that are processes, or Dask workers.
    threshold : float
        Below this size-skew cells are corrected; 0: none.
    """
    with tempfile.TemporaryDirectory(prefix="mesh-motion-partitions-") as folder:
        files = write_partitions(Path(folder), mesh, ranks)
        found = _on_workers(files, threshold) if volume == "dask" else _on_ranks(files, volume, threshold)
    sums = {name: sum(one[name] for one in found) for name in ("sent", "received", "corrected")}
    most = {name: max(one[name] for one in found) for name in ("step", "work", "opened", "memory")}
    return sums | most | {name: found[0][name] for name in ("freed", "reached")}


def load(name: str, folder: Path) -> MeshFile:
    """A benchmark mesh; built if necessary."""
    stored = load_or_build(name, folder)
    cells = {kind: nodes.astype(np.int64) for kind, nodes in stored.cells.items()}
    patches = {"body": np.unique(stored.moving), "box": np.unique(stored.fixed)}
    return MeshFile(stored.points, cells, patches, Path(name))


def main() -> None:
    """Run the cases that the command line selects."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.distributed.own_ranks", description=__doc__)
    parser.add_argument("mesh", nargs="?", default="M4")
    parser.add_argument(
        "--meshes", type=Path, default=Path("out/peers"), help="folder of the meshes; missing ones are built"
    )
    parser.add_argument("--ranks", nargs="+", type=int, default=[1, 2], metavar="N")
    parser.add_argument("--dask", action="store_true", help="measure also on the workers of a Dask cluster")
    parser.add_argument(
        "--corrected", type=float, default=0.0, metavar="THRESHOLD", help="correct up to this size-skew"
    )
    arguments = parser.parse_args()
    os.environ["MESH_MOTION_THREADS"] = "1"
    mesh = load(arguments.mesh, arguments.meshes)
    more = " corrected | freed | reached |" if arguments.corrected else ""
    titles = "| mesh | volume | ranks | sent | received | step, ms | rank's work, ms | opening, s | session's memory |"
    print(f"{titles}{more}\n|---|---|{'---:|' * (titles.count('|') - 3 + more.count('|'))}")
    volumes = ("client", "dask") if arguments.dask else ("client",)
    for volume, ranks in [("server", 1), *((volume, ranks) for volume in volumes for ranks in arguments.ranks)]:
        row = measured(mesh, ranks, volume, arguments.corrected)
        sent, received, memory = (f"{row[name] / 1e6:.2f} MB" for name in ("sent", "received", "memory"))
        print(
            f"| {arguments.mesh} | {volume} | {ranks} | {sent} | {received} | {1000 * row['step']:.0f} | "
            f"{1000 * row['work']:.0f} | {row['opened']:.1f} | {memory} |"
            + (f" {row['corrected']:.0f} | {row['freed']:.0f} | {row['reached']:.3f} |" if more else ""),
            flush=True,
        )


if __name__ == "__main__":
    main()
