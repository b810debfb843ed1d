"""The golden vectors, sent to a server: frames that are not a message are refused with the vector's code, others not.

They are read from ``mesh_motion_protocol/vectors``, which are part of SPEC.md; nothing else of that package is used.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from importlib.resources import files
from typing import Any

import msgpack

from mesh_motion_conformance.case import require
from mesh_motion_conformance.checks import refused
from mesh_motion_conformance.server.stage import Stage, suite
from mesh_motion_conformance.show import show
from mesh_motion_conformance.tables import tables

__all__ = ["load_vectors"]

#: Errors of malformed messages. A well-formed message may get others: its session does not exist, or it is too early.
_MALFORMED = ("INVALID_ARGUMENT.HEADER", "INVALID_ARGUMENT.FRAMES", "INVALID_ARGUMENT.DTYPE", "INVALID_ARGUMENT.SHAPE",
              "UNIMPLEMENTED.VERSION", "INTERNAL")  # fmt: skip


def load_vectors(name: str) -> list[dict[str, Any]]:
    """``valid`` or ``invalid``: each with ``name``, ``frames`` (bytes) and the message or the error code."""
    text = files("mesh_motion_protocol").joinpath("vectors", f"{name}.json").read_text(encoding="utf-8")
    return [case | {"frames": [bytes.fromhex(frame) for frame in case["frames"]]} for case in json.loads(text)]


def _kind(frames: list[bytes]) -> str:
    """The message type that a tolerant reader finds."""
    try:
        return str(msgpack.unpackb(frames[0], raw=False, strict_map_key=False)["type"])
    except Exception:
        return "PING"


def _is_request(kind: str) -> bool:
    return kind in tables().requests or kind not in tables().messages


def _refuse(stage: Stage, vector: dict[str, Any], at_data: bool) -> None:
    line = stage.session("READY").lines[0] if at_data else stage.control
    stage.put(line, vector["frames"])
    refused(line.receive(), vector["error"])


@suite.family(_refuse)
def invalid() -> Iterator[tuple[Any, ...]]:
    """Frames that are not a message."""
    for vector in load_vectors("invalid"):
        kind = _kind(vector["frames"])
        if _is_request(kind):
            at_data = tables().requests.get(kind, {}).get("endpoint") == "data"
            yield vector["section"], f"vector-{vector['name']}", vector["why"], vector, at_data


def _understand(stage: Stage, vector: dict[str, Any], at_data: bool) -> None:
    line = stage.session("READY").connect() if at_data else stage.line()
    stage.put(line, vector["frames"])
    reply = line.receive(stage.opening_seconds)
    line.close()
    code = reply.fields.get("code", "")
    require(code not in _MALFORMED, f"{vector['message']['type']} to be understood", show(reply))


@suite.family(_understand)
def valid() -> Iterator[tuple[Any, ...]]:
    """Frames that are a request."""
    for vector in load_vectors("valid"):
        kind = vector["message"]["type"]
        if kind in tables().requests and kind != "OPEN":
            at_data = tables().requests[kind]["endpoint"] == "data"
            yield vector["section"], f"vector-{vector['name']}", f"the frames are a {kind}", vector, at_data
