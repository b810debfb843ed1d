"""One message of every type with fixed content: the source of the valid vectors."""

from __future__ import annotations

from typing import Any

import numpy as np

from mesh_motion_protocol import messages as m

__all__ = ["MESSAGES"]

_ID: dict[str, Any] = {"client": bytes(range(16)), "sequence": 7}
_SESSION = "0123456789abcdef0123456789abcdef"
_TOKEN = bytes(range(100, 132))
_AT: dict[str, Any] = {**_ID, "session": _SESSION, "epoch": 1}
_ENDPOINT = "tcp://127.0.0.1:40001"
_POINTS = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [-0.0, 1e-300]])
_STATISTICS = {"min": 0.5, "mean": 0.9, "p1": 0.55, "p5": 0.6, "p50": 0.95}
_WORST = {"partition": 0, "type": "triangle", "cell": 3, "centre": [0.25, 0.75], "size": 0.81, "skew": 0.9,
          "size_skew": 0.81, "metric": 0.81}  # fmt: skip
_SUMMARY = {"size": _STATISTICS, "skew": _STATISTICS, "size_skew": _STATISTICS, "metric": _STATISTICS, "inverted": 0,
            "cells": 2, "worst": [_WORST]}  # fmt: skip
_FACES = {"faces": 1, "max_non_orthogonality": 12.5, "faces_above_65": 0, "faces_above_75": 0, "max_skewness": 0.25,
          "min_volume_ratio": 0.75, "shortest_edge": 0.5, "smallest_face": 0.375, "worst": [
              {"partition": 0, "type": "triangle", "cell": 0, "centre": [0.5, 0.5], "non_orthogonality": 12.5,
               "neighbour": {"partition": 0, "type": "triangle", "cell": 1}}]}  # fmt: skip

#: A sample of each type, in the order of the catalogue of messages.
MESSAGES: tuple[m.Message, ...] = (
    m.Hello(**_ID, versions=[[1, 0]], features=[], agent="sample 1.0"),
    m.Welcome(**_ID, version=[1, 0], features=[], server="mesh-motion-server 0.1.0", boot=bytes(range(16, 32)),
              limits={"max_header_bytes": 65536}, durability=["full"]),
    m.Open(**_ID, dimension=2, partitions=1, settings={"support_radius": 0.5}, label="flag", bytes_reserved=4096,
           durability="full", time=0.25, time_levels="bdf2"),
    m.Opened(**_ID, session=_SESSION, token=_TOKEN, endpoint=_ENDPOINT, epoch=1),
    m.Resume(**_ID, session=_SESSION, token=_TOKEN),
    m.Resumed(**_ID, session=_SESSION, endpoint=_ENDPOINT, epoch=2, state="READY", step=12),
    m.List(**_ID, after=""),
    m.Listed(**_ID, sessions=[{"session": _SESSION, "label": "flag", "state": "READY", "step": 12, "partitions": 1,
                               "worker": "alive"}], more=False),
    m.Probe(**_ID, session=_SESSION, token=_TOKEN),
    m.Probed(**_ID, session=_SESSION, worker="alive", epoch=2, endpoint=_ENDPOINT),
    m.Ping(**_ID),
    m.Pong(**_ID),
    m.Join(**_AT, partition=0, token=_TOKEN),
    m.Joined(**_ID, state="READY", step=12, iteration=0, dimension=2, partitions=1, nodes=4, extent=0.5, time=0.25,
             moving_patches=[["flag", 2]], moving_nodes=np.array([2, 3], dtype=np.int64),
             patch_nodes=np.array([3, 2], dtype=np.int64)),
    m.Upload(**_AT, partition=0, item="nodes", name="", role="", rows=_POINTS),
    m.Uploaded(**_ID, rows_total=4),
    m.Build(**_AT, partition=0, reach=0.125),
    m.Built(**_ID, step=0, settings={"basis": "wendland-c2", "support_radius": 0.5}, mesh={"nodes": 4, "cells": 2},
            quality=_SUMMARY, derivatives=True, reach=0.25, moving_nodes=np.array([2, 3], dtype=np.int64),
            wall=np.array([[0.0, 0.5, 1 / 3, 1.0]])),
    m.Move(**_AT, partition=0, step=13, frame="committed", report="faces", headroom_along="displacement", time=0.375,
           velocity="bdf2",
           displacement=np.array([[0.125, -0.25], [1 / 3, 2e-16]])),
    m.Moved(**_ID, step=13, iteration=1,
            quality={"metric": "size-skew", "threshold": 0.2, "standard": _SUMMARY, "corrected": _SUMMARY},
            correction={"method": "none", "enrichment_points": 0}, caches={"factorization": "reused"},
            seconds={"total": 0.03125}, warnings=[], faces={"before": _FACES, "after": _FACES},
            sums=[{"basis": "wendland-c2", "radius": 0.5, "centres": 2}], displacement=_POINTS / 8,
            velocity=_POINTS / 2, swept=np.array([1 / 3, -0.0]),
            enrichment_points=np.empty((0, 2)), centres=_POINTS[:2], boxes=np.empty((0, 14)), coefficients=_POINTS[2:]),
    m.Tangent(**_AT, partition=0, what="trial",
              velocity=np.array([[0.125, -0.25, 1.0, 0.0], [1 / 3, 2e-16, 0.0, 1.0]])),
    m.TangentFound(**_ID, step=12, iteration=1, velocity=np.hstack([_POINTS, _POINTS / 8]),
                   coefficients=np.hstack([_POINTS, _POINTS]) / 7, freed=np.array([7]),
                   freed_velocity=np.array([[0.5, -0.25, 1.0, 0.0]])),
    m.Cotangent(**_AT, partition=0, what="trial", weights=_POINTS / 3, coefficients=_POINTS / 7,
                region=np.array([7, 9]), region_weights=np.array([[0.125, -0.25], [1 / 3, 2e-16]])),
    m.CotangentFound(**_ID, step=12, iteration=0, weights=np.array([[0.125, -0.25], [1 / 3, 2e-16]])),
    m.Judge(**_AT, partition=0, step=13,
            part={"cells": 2, "inverted": 0, "sums": {"size": 1.5}, "minima": {"size": 0.5}},
            questions=[{"metric": "size", "way": []}, {"metric": "size", "way": [[-1.0, 1024.0, 1536]]}],
            bins=np.array([[0, 1536, 1], [0, 2047, 1], [1, 0, 1]]), values=np.array([[0, 0.5, 1], [0, 1, 1]]),
            worst=np.array([[1, 3, 0.81, 0.81, 0.9, 0.81, 0.25, 0.75]])),
    m.Judged(**_ID, step=13, questions=[{"metric": "skew", "way": [[-1.0, 1024.0, 1536]]}], quality={}, reached=False,
             warnings=[]),
    m.Correct(**_AT, partition=0, step=13, what="trial",
              part={"metric": "skew", "below": 0.23, "rings": 4, "cells": {"triangle": 1}, "interior": 7,
                    "least": [0.9, 0.5]},
              nodes=np.array([[2, 1], [0, 0], [3, 1]]), points=_POINTS[:3], positions=_POINTS[1:],
              corners=np.array([[0], [1], [2]])),
    m.Corrected(**_ID, step=13, region={}, nodes=np.array([2, 3]), displacement=_POINTS[:2] / 8),
    m.Commit(**_AT, partition=0, step=13, time=0.375),
    m.Committed(**_ID, step=13, durable_step=13, digest=bytes(range(200, 232)), quality=_SUMMARY),
    m.Rollback(**_AT, partition=0, step=13),
    m.RolledBack(**_ID, step=12),
    m.Fetch(**_AT, partition=0, what="reference"),
    m.Fetched(**_ID, step=12, points=_POINTS),
    m.Status(**_AT, partition=0),
    m.StatusReport(**_ID, state="TRIAL", step=12, iteration=3, waiting_for=[], report={"moves": 40},
                   durable_step=12),
    m.Close(**_AT, partition=0, outcome="keep"),
    m.Closed(**_ID, step=12),
    m.ErrorReply(**_ID, code="INVALID_ARGUMENT.NONFINITE", message="displacement must be finite, got nan at row 1",
                 hint="look at the sender's solver first", retryable=False, state="READY",
                 details={"field": "displacement", "row": 1}),
)  # fmt: skip
