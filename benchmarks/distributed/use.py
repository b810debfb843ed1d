"""Resources that a rank's process uses: bytes on the network, processor time, its session's memory."""

from __future__ import annotations

import asyncio
import time
from collections import Counter
from typing import Any

from mesh_motion_client import connection, dask_worker
from mesh_motion_client import server as client
from mesh_motion_protocol.messages import Correct

__all__ = ["BYTES", "count_bytes", "peak_memory", "spent"]

BYTES: Counter[str] = Counter()


def count_bytes() -> None:
    """Count bytes that this process sends and receives from now on, with all arrays as frames, as between machines."""
    client.SUPPORTED = False  # type: ignore[attr-defined]
    encode, decode = connection.encode, connection.decode  # type: ignore[attr-defined]

    def counted_encode(message: Any) -> Any:
        frames = encode(message)
        BYTES["corrected"] += len(message.nodes) if isinstance(message, Correct) else 0
        BYTES["sent"] += sum(memoryview(frame).nbytes for frame in frames)
        return frames

    def counted_decode(frames: Any, **options: Any) -> Any:
        BYTES["received"] += sum(memoryview(frame).nbytes for frame in frames)
        return decode(frames, **options)

    connection.encode, connection.decode = counted_encode, counted_decode  # type: ignore[assignment,attr-defined]


def spent() -> dict[str, float]:
    """The resources that a worker has used so far."""
    return {"work": time.process_time(), **{name: BYTES[name] for name in ("sent", "received", "corrected")}}


async def peak_memory() -> int:
    """The peak memory of the session, asked from the rank on this worker."""
    (rank,) = dask_worker._RANKS.values()
    assert rank.session is not None
    report = await asyncio.get_running_loop().run_in_executor(rank.thread, rank.session.status)
    return int(report.report["peak_memory_bytes"])
