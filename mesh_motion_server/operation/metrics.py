"""Every metric by name: what it counts, its unit and its label. No other metric is shown.

No metric has data about a single session: no ids, labels, users, paths or coordinates. No label of a metric has values
that a client chooses.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

#: Prefix of each name.
PREFIX = "mesh_motion_"

#: Buckets in half decades, from moves of small meshes to those of millions of nodes.
_SECONDS = (0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0)
_SHORT_SECONDS = (0.0001, 0.0003, 0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0)
#: 14 is the bound of the alert MeshMotionMeshEndsSoon (docs/operations.md).
_STEPS = (1.0, 2.0, 3.0, 5.0, 8.0, 14.0, 20.0, 50.0)
#: Finest up to 0.2, the default quality_threshold.
_QUALITIES = (0.0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8)


@dataclass(frozen=True)
class Metric:
    """One line of the table."""

    name: str  # name without the prefix; a counter's without ``_total``
    kind: Literal["counter", "gauge", "histogram"]
    text: str  # description, with the unit
    label: str = ""  # name of the label; empty without one
    #: Label values that are shown as 0 before the first count, so that the first increase is visible.
    shown: tuple[str, ...] = ()
    bounds: tuple[float, ...] = ()  # for a histogram: the upper limits of its buckets, ascending


METRICS = {
    metric.name: metric
    for metric in (
        Metric("sessions", "gauge", "Sessions with a worker, by state.", "state"),
        Metric("moves", "counter", "Computed moves, without repeats of answered requests."),
        Metric("commits", "counter", "Answered commits; with durability relaxed they reach the disk later."),
        Metric("builds", "counter", "Meshes built."),
        Metric("move_seconds", "histogram", "Time to compute a move, in seconds.", bounds=_SECONDS),
        Metric("commit_seconds", "histogram", "Time to commit, in seconds.", bounds=_SECONDS),
        Metric("build_seconds", "histogram", "Time to check a mesh and make it durable, in seconds.", bounds=_SECONDS),
        Metric(
            "move_min_quality",
            "histogram",
            "Predicted minimum quality of each move, after its correction, in the session's metric (a ratio).",
            bounds=_QUALITIES,
        ),
        Metric(
            "move_headroom_steps",
            "histogram",
            "Number of further equal steps until a cell inverts, for each move that requested it; 100: 100 or more.",
            bounds=_STEPS,
        ),
        Metric("corrections", "counter", "Moves whose prediction was corrected, by method.", "method"),
        Metric("predicted_inverted_cells", "counter", "Cells that moves would have inverted without correction."),
        Metric("refused", "counter", "Requests answered with an error, by its code.", "code", ("INTERNAL",)),
        Metric("received_bytes", "counter", "Bytes of requests received."),
        Metric("sent_bytes", "counter", "Bytes of replies sent."),
        Metric("denied_connections", "counter", "Handshakes refused because the key is not on the allow-list."),
        Metric("fsync_seconds", "histogram", "Time of one fsync of the journals, in seconds.", bounds=_SHORT_SECONDS),
        Metric("journal_written_bytes", "counter", "Bytes written to sessions' folders."),
        Metric("worker_starts", "counter", "Started worker processes: one for each session and each restart."),
        Metric(
            "worker_ends",
            "counter",
            "Worker processes ended: orderly, or by a failure or a signal.",
            "how",
            ("orderly", "failure", "signal"),
        ),
        Metric("gateway_starts", "counter", "Starts of the gateway process."),
        Metric("gateway_falls", "counter", "Unexpected ends of the gateway process."),
        Metric("worker_resident_bytes", "gauge", "Resident memory of all workers together, in bytes."),
        Metric("largest_worker_resident_bytes", "gauge", "Resident memory of the largest worker, in bytes."),
        Metric("disk_free_bytes", "gauge", "Free space of the disk with the state folder, in bytes."),
        Metric("disk_size_bytes", "gauge", "Size of the disk with the state folder, in bytes."),
        Metric("disk_silence_seconds", "gauge", "Time for which that disk has not answered, in seconds."),
        Metric("memory_available_bytes", "gauge", "Memory available to this server (machine or cgroup), in bytes."),
        Metric("ready", "gauge", "1 if /readyz answers 200, else 0."),
    )
}
