"""The correct part of the scripted server: one session with the contract's mesh; each request is executed once."""

from __future__ import annotations

import hashlib
import struct
from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np

from mesh_motion_conformance.client.contract import LEFT, POINTS, displacement_of
from mesh_motion_conformance.tables import tables
from mesh_motion_conformance.wire import Array, Message

__all__ = ["Reply", "ScriptedSession", "error"]

_STATISTICS = {"min": 1.0, "mean": 1.0, "p1": 1.0, "p5": 1.0, "p50": 1.0}
_WORST = {"partition": 0, "type": "triangle", "cell": 0, "centre": [0.5, 0.5], "size": 1.0, "skew": 1.0,
          "size_skew": 1.0, "metric": 1.0}  # fmt: skip
SUMMARY: dict[str, Any] = dict.fromkeys(("size", "skew", "size_skew", "metric"), _STATISTICS) | {
    "inverted": 0, "cells": 2, "worst": [_WORST],
}  # fmt: skip
SESSION, TOKEN = "0123456789abcdef" * 2, bytes(range(32))


class Reply:
    """A reply before it is encoded: kind, fields, arrays."""

    def __init__(self, kind: str, fields: dict[str, Any], arrays: dict[str, Array] | None = None) -> None:
        self.kind, self.fields, self.arrays = kind, fields, arrays or {}


def error(code: str, state: str = "", **details: Any) -> Reply:
    """An ERROR with this code."""
    row = tables().errors.get(code) or tables().errors[code.partition(".")[0]]
    rest = {"message": "as the script has it", "hint": "none", "state": state, "details": details}
    return Reply("ERROR", {"code": code, "retryable": row["retryable"]} | rest)


class ScriptedSession:
    """One session.

    Attributes
    ----------
    executed : Counter
        Number of executed requests of each kind.
    """

    def __init__(self) -> None:
        self.executed: Counter[str] = Counter()
        self.state, self.step, self.iteration, self.epoch = "NEW", 0, 0, 1
        self.points = POINTS.copy()
        self._trial: Array | None = None
        self._before: list[Array] = []
        self._forgotten = False
        self._lost_trial = False
        self._stored: dict[tuple[bytes, int], tuple[Any, Reply]] = {}

    def answer(self, request: Message) -> Reply:
        """The reply; a repeat gets the stored one."""
        kind, fields = request.kind, request.fields
        if fields["epoch"] != self.epoch:
            return error("ABORTED.FENCED", self.state)
        key, content = (request.client, request.sequence), _content(request)
        if key in self._stored:
            known, stored = self._stored[key]
            return stored if known == content else error("ABORTED.CONFLICT", self.state)
        if kind in ("COMMIT", "MOVE", "ROLLBACK") and fields["step"] != self.step + 1:
            lost = self._forgotten and fields["step"] > self.step + 1
            code = "ABORTED.STEPS_LOST" if lost else "FAILED_PRECONDITION.STEP"
            return error(code, self.state, expected=self.step + 1, got=fields["step"])
        allowed = tables().states[self.state].get(kind, self.state)
        if allowed is None:
            lost = kind == "COMMIT" and self._lost_trial
            return error("ABORTED.TRIAL_LOST" if lost else "FAILED_PRECONDITION.STATE", self.state)
        self.executed[kind] += 1
        reply: Reply = getattr(self, f"_{kind.lower()}")(request)
        self.state = self.state if kind == "JOIN" else allowed
        if kind in ("UPLOAD", "BUILD", "MOVE", "COMMIT", "ROLLBACK"):
            self._stored[key] = (content, reply)
        return reply

    def lose_worker(self) -> None:
        """Keep only the data in the journal: the committed state and the replies to COMMITs."""
        self._drop_trial()
        self._stored = {key: entry for key, entry in self._stored.items() if entry[1].kind == "COMMITTED"}

    def forget(self, steps: int) -> None:
        """Lose the last committed steps and the replies to their COMMITs."""
        self.lose_worker()
        self._forgotten, self.step = True, self.step - steps
        self.points, self._before = self._before[self.step], self._before[: self.step]
        self._stored = {k: entry for k, entry in self._stored.items() if entry[1].fields["step"] <= self.step}

    def resume(self) -> Reply:
        """RESUMED, under the next epoch."""
        self.epoch += 1
        self._drop_trial()
        return Reply("RESUMED", {"session": SESSION, "epoch": self.epoch, "state": self.state, "step": self.step})

    def _drop_trial(self) -> None:
        if self.state == "TRIAL":
            self.state, self._trial, self.iteration, self._lost_trial = "READY", None, 0, True

    # --- requests ----------------------------------------------------------------------------------------------------

    def _join(self, _: Message) -> Reply:
        fields = {"state": self.state, "step": self.step, "iteration": self.iteration, "dimension": 2, "partitions": 1}
        built = self.state in ("READY", "TRIAL")
        if not built:
            return Reply("JOINED", fields | {"nodes": 0}, {})
        fields |= {"nodes": 4, "extent": 1.0, "moving_patches": [["left", 2]]}
        return Reply("JOINED", fields, {"moving_nodes": LEFT, "patch_nodes": LEFT})

    def _upload(self, request: Message) -> Reply:
        return Reply("UPLOADED", {"rows_total": len(request.arrays["rows"])})

    def _build(self, _: Message) -> Reply:
        patches = {"left": {"role": "moving", "nodes": 2}, "right": {"role": "fixed", "nodes": 2}}
        mesh = {"nodes": 4, "cells": {"triangle": 2}, "patches": patches, "moving_nodes": 2,
                "box": [[0.0, 0.0], [1.0, 1.0]], "warnings": []}  # fmt: skip
        settings = {key: row["default"] for key, row in tables().settings.items()}
        fields = {"step": 0, "settings": settings, "mesh": mesh, "quality": SUMMARY}
        return Reply("BUILT", fields, {"moving_nodes": LEFT})

    def _move(self, request: Message) -> Reply:
        base = self.points if request.fields.get("frame", "committed") == "committed" else POINTS
        displacement = displacement_of(request.arrays["displacement"])
        self._trial, self._lost_trial = base + displacement, False
        self.iteration += 1
        correction = {"method": "none", "enrichment_points": 0, "freed_nodes": 0, "iterations": 0, "reached": True,
                      "control_points": 4, "support_radius": 1.0, "sub_steps": 1}  # fmt: skip
        fields = {
            "step": self.step + 1, "iteration": self.iteration, "correction": correction, "warnings": [],
            "quality": {"metric": "size-skew", "threshold": 0.2, "standard": SUMMARY, "corrected": SUMMARY},
            "caches": {"factorization": "made"},
            "seconds": dict.fromkeys(("solve", "predict", "correct", "displace", "total"), 0.001),
        }  # fmt: skip
        return Reply("MOVED", fields, {"displacement": displacement, "enrichment_points": np.empty((0, 2))})

    def _tangent(self, request: Message) -> Reply:
        return self._found(request, "velocity", displacement_of)

    def _cotangent(self, request: Message) -> Reply:
        return self._found(request, "weights", lambda weights: weights[LEFT])

    def _found(self, request: Message, name: str, linear: Callable[[Array], Array]) -> Reply:
        """The derivative of a motion of the left side alone."""
        if request.fields["what"] == "trial" and self._trial is None:
            return error("ABORTED.TRIAL_LOST" if self._lost_trial else "FAILED_PRECONDITION.STATE", self.state)
        fields = {"step": self.step, "iteration": self.iteration}
        return Reply(f"{request.kind}_FOUND", fields, {name: linear(request.arrays[name])})

    def _commit(self, _: Message) -> Reply:
        self._before.append(self.points)
        if self._trial is not None:
            self.points = self._trial
        self.step, self._trial, self.iteration = self.step + 1, None, 0
        text = b"mesh-motion state 1\n" + struct.pack("<qqq", self.step, 4, 2) + self.points.astype("<f8").tobytes()
        digest = hashlib.sha256(text).digest()
        fields = {"step": self.step, "durable_step": self.step, "digest": digest, "quality": SUMMARY}
        return Reply("COMMITTED", fields)

    def _rollback(self, _: Message) -> Reply:
        self._trial, self.iteration, self._lost_trial = None, 0, False
        return Reply("ROLLED_BACK", {"step": self.step})

    def _fetch(self, request: Message) -> Reply:
        committed = request.fields.get("what", "committed") == "committed"
        return Reply("FETCHED", {"step": self.step}, {"points": self.points if committed else POINTS})

    def _status(self, _: Message) -> Reply:
        fields = {"state": self.state, "step": self.step, "iteration": self.iteration, "waiting_for": [], "report": {}}
        return Reply("STATUS_REPORT", fields)

    def _close(self, _: Message) -> Reply:
        return Reply("CLOSED", {"step": self.step})


def _content(request: Message) -> tuple[Any, ...]:
    """Type, fields and arrays, without ``epoch`` and ``memory``."""
    fields = sorted((name, repr(value)) for name, value in request.fields.items() if name not in ("epoch", "memory"))
    return request.kind, tuple(fields), tuple((name, a.shape, a.tobytes()) for name, a in request.arrays.items())
