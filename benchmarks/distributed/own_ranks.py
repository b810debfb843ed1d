"""Steps of a session whose ranks evaluate the field: ``python -m benchmarks.distributed.own_ranks M4``.

Each rank is a process of one thread that has its partition; they move and judge it. For comparison the same steps of a
session that has the whole mesh. Prints one row a case: bytes of a step each way, all ranks together, seconds,
processor time of the busiest rank, and the session's memory. With ``--corrected 0.25`` each step turns the body so far
that cells are below that size-skew and are corrected; how many nodes the ranks tell of, and how many are freed.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from mesh_motion_client import Mesh, Patch, connect, connection
from mesh_motion_client import server as client
from mesh_motion_protocol.messages import Correct

from benchmarks.distributed.cases import PartitionCase, load
from benchmarks.peers.motions import MOTIONS
from mesh_motion_server.distributed.split import Split

__all__ = ["measured"]

SETTINGS = {"displacement": "absolute", "correction": "none", "sub_steps": "never", "boundary_layer_thickness": 0.0}
STEPS = 4
_BYTES: Counter[str] = Counter()


def _count_bytes() -> None:
    """Count what this process sends and receives from now on."""
    encode, decode = connection.encode, connection.decode

    def counted_encode(message: Any) -> Any:
        frames = encode(message)
        _BYTES["told"] += len(message.nodes) if isinstance(message, Correct) else 0
        _BYTES["sent"] += sum(memoryview(frame).nbytes for frame in frames)
        return frames

    def counted_decode(frames: Any, **options: Any) -> Any:
        _BYTES["received"] += sum(memoryview(frame).nbytes for frame in frames)
        return decode(frames, **options)

    connection.encode, connection.decode = counted_encode, counted_decode  # type: ignore[attr-defined]


def _pieces(case: PartitionCase, ranks: int) -> list[Mesh]:
    """One partition a rank; every rank lists the nodes of patches that it holds."""
    split, pieces = Split.build(case.points, case.cells, ranks), []
    for rank in range(ranks):
        part = split.partition(rank)
        patches = {}
        for name, patch in case.patches.items():
            rows = np.flatnonzero(np.isin(part.nodes, patch.nodes))
            if len(rows):
                patches[name] = Patch(patch.role, rows)
        pieces.append(Mesh(part.points, {b.type.name: b.nodes for b in part.cells}, patches, part.nodes))
    return pieces


def _settings(threshold: float) -> dict[str, Any]:
    corrected = {"correction": "optimised", "correction_target": "threshold", "quality_metric": "size-skew"}
    return SETTINGS | (corrected | {"quality_threshold": threshold} if threshold else {})


def _motion(body: Any, step: int, threshold: float) -> Any:
    """Displacement of the body's nodes (k, d): a small one, or one of which cells are bad."""
    if not threshold:
        return 0.003 * np.sin(3.0 * body[:, ::-1] + step)
    return MOTIONS["T3"].displacements(body, 1)[-1] * (1.0 - 0.001 * step)


def _rank(endpoint: str, mesh: Mesh, rank: int, ranks: int, evaluation: str, threshold: float, lines: Any) -> None:
    """Open or join, make some steps, and tell what they took."""
    _count_bytes()
    client.SUPPORTED = False  # all arrays as frames, as between machines
    with connect(endpoint) as server:
        began = time.perf_counter()
        if rank == 0:
            told = lambda credentials: [line.put(credentials) for line in lines[1:ranks]]  # noqa: E731
            options = {"partitions": ranks, "evaluation": evaluation, "announce": told}
            session = server.open(mesh, _settings(threshold), **options)
        else:
            session = server.join(lines[rank].get(), mesh, partition=rank)
        opened, steps, work, used = time.perf_counter() - began, [], [], []
        with session:
            body = mesh.points[session.moving_nodes]
            for step in range(1, STEPS + 1):
                before, began, begun = dict(_BYTES), time.perf_counter(), time.process_time()
                moved = session.move(_motion(body, step, threshold))
                session.commit()
                steps.append(time.perf_counter() - began)
                work.append(time.process_time() - begun)
                used.append({name: _BYTES[name] - before.get(name, 0) for name in _BYTES})
            memory = session.status().report["peak_memory_bytes"]
        told = {"opened": opened, "step": min(steps[1:]), "work": min(work[1:]), "memory": memory}
        told |= {"freed": moved.correction["freed_nodes"], "reached": moved.quality["corrected"]["size_skew"]["min"]}
        lines[-1].put(told | used[-1])


def measured(case: PartitionCase, ranks: int, evaluation: str, threshold: float = 0.0) -> dict[str, float]:
    """The figures of one case, the ranks' together; ``boundary``: nodes that the session holds."""
    context = multiprocessing.get_context("spawn")
    with connect(server_options=["--threads", "1"]) as server:
        lines = [context.Queue() for _ in range(ranks + 1)]
        arguments = [
            (server.endpoint, mesh, rank, ranks, evaluation, threshold, lines)
            for rank, mesh in enumerate(_pieces(case, ranks))
        ]
        processes = [context.Process(target=_rank, args=given) for given in arguments]
        for process in processes:
            process.start()
        found = [lines[-1].get() for _ in processes]
        for process in processes:
            process.join()
    return {
        "sent": sum(one["sent"] for one in found),
        "received": sum(one["received"] for one in found),
        "step": max(one["step"] for one in found),
        "work": max(one["work"] for one in found),
        "opened": max(one["opened"] for one in found),
        "memory": max(one["memory"] for one in found),
        "told": sum(one["told"] for one in found),
        "freed": found[0]["freed"],
        "reached": found[0]["reached"],
    }


def main() -> None:
    """Run what the command line asks for."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.distributed.own_ranks", description=__doc__)
    parser.add_argument("mesh", nargs="?", default="M4")
    parser.add_argument("--meshes", type=Path, default=Path("out/peers"), help="folder of the meshes, built if need be")
    parser.add_argument("--ranks", nargs="+", type=int, default=[1, 2], metavar="N")
    parser.add_argument("--corrected", type=float, default=0.0, metavar="THRESHOLD", help="smallest size-skew")
    arguments = parser.parse_args()
    os.environ["MESH_MOTION_THREADS"] = "1"
    case = load(arguments.mesh, arguments.meshes)
    more = " told | freed | reached |" if arguments.corrected else ""
    titles = "| mesh | volume | ranks | sent | received | step, ms | rank's work, ms | opening, s | session's memory |"
    print(f"{titles}{more}\n|---|---|{'---:|' * (titles.count('|') - 3 + more.count('|'))}")
    for evaluation, ranks in [("server", 1), *(("client", ranks) for ranks in arguments.ranks)]:
        row = measured(case, ranks, evaluation, arguments.corrected)
        sent, received, memory = (f"{row[name] / 1e6:.2f} MB" for name in ("sent", "received", "memory"))
        print(
            f"| {case.name} | {evaluation} | {ranks} | {sent} | {received} | {1000 * row['step']:.0f} | "
            f"{1000 * row['work']:.0f} | {row['opened']:.1f} | {memory} |"
            + (f" {row['told']:.0f} | {row['freed']:.0f} | {row['reached']:.3f} |" if more else ""),
            flush=True,
        )


if __name__ == "__main__":
    main()
