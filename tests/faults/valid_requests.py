"""Requests that a session would take, as the headers and frames of the wire: what a fuzz begins with."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from random import Random
from typing import Any

import numpy as np

from tests.faults.ranks import shared_mesh, uploads_of

CONTROL = ("HELLO", "OPEN", "RESUME", "LIST", "PROBE", "PING")
DATA = (
    "JOIN", "UPLOAD", "BUILD", "MOVE", "TANGENT", "COTANGENT", "JUDGE", "CORRECT", "COMMIT", "ROLLBACK", "FETCH",
    "STATUS", "CLOSE", "PING",
)  # fmt: skip
_SETTINGS: tuple[dict[str, Any], ...] = (
    {}, {"basis": "wendland-c4"}, {"correction": "none", "quality_threshold": 0.1}, {"support_radius": 2.5},
    {"reduction": "greedy"},
)  # fmt: skip


@dataclass
class Request:
    """A header, not yet packed, and the frames behind it."""

    header: dict[str, Any]
    frames: list[bytes] = field(default_factory=list)

    @property
    def kind(self) -> str:
        """Its type."""
        return str(self.header["type"])


@dataclass
class Known:
    """What a client knows of its session.

    ``sequence``: the last one that was used.
    """

    session: str
    token: bytes
    epoch: int
    partitions: int
    step: int = 0
    sequence: int = 0
    uploads: list[list[dict[str, Any]]] = field(default_factory=list)
    moving: list[np.ndarray[Any, Any]] = field(default_factory=list)

    def __post_init__(self) -> None:
        meshes = shared_mesh(self.partitions)
        self.uploads = [uploads_of(mesh, self.partitions) for mesh in meshes]
        self.moving = [mesh.points[np.sort(mesh.patches["left"].nodes), 1] for mesh in meshes]


def valid_request(kind: str, known: Known, partition: int, random: Random) -> Request:
    """A request of a partition that fits the session, if its state does too."""
    request = _bare(kind, known, partition)
    more = _MORE.get(kind)
    if more is not None:
        request.header["fields"] |= more(request, known, partition, random)
    return request


def upload_of(known: Known, partition: int, part: dict[str, Any]) -> Request:
    """The UPLOAD of a part of a partition's mesh."""
    request = _bare("UPLOAD", known, partition)
    request.header["fields"] |= _part(request, part)
    return request


def _bare(kind: str, known: Known, partition: int) -> Request:
    """With an id and an address."""
    known.sequence += 1
    header: dict[str, Any] = {"v": 1, "type": kind, "client": bytes([partition + 1]) * 16, "sequence": known.sequence}
    fields = {"session": known.session, "epoch": known.epoch, "partition": partition}
    header |= {"fields": fields if kind in DATA and kind != "PING" else {}, "arrays": []}
    return Request(header)


def _array(request: Request, name: str, rows: np.ndarray[Any, Any]) -> None:
    """Declare an array, and put its frame behind."""
    dtype = "<f8" if rows.dtype.kind == "f" else "<i8"
    request.header["arrays"].append({"name": name, "dtype": dtype, "shape": list(rows.shape)})
    if rows.size:
        request.frames.append(rows.astype(dtype).tobytes())


def _open(_request: Request, _known: Known, _partition: int, random: Random) -> dict[str, Any]:
    return {"dimension": random.choice((1, 2, 3)), "partitions": random.choice((1, 2, 256)), "label": "a label",
            "settings": dict(random.choice(_SETTINGS)), "bytes_reserved": 1000, "durability": "",
            "time": -1.5, "time_levels": random.choice(("", "bdf2", "bossak"))}  # fmt: skip


def _address(_request: Request, known: Known, _partition: int, _random: Random) -> dict[str, Any]:
    return {"session": known.session, "token": known.token}


def _upload(request: Request, known: Known, partition: int, random: Random) -> dict[str, Any]:
    return _part(request, random.choice(known.uploads[partition]))


def _part(request: Request, part: dict[str, Any]) -> dict[str, Any]:
    _array(request, "rows", part["rows"])
    return {"item": part["item"], "name": part.get("name", ""), "role": part.get("role", "")}


def _move(request: Request, known: Known, partition: int, random: Random) -> dict[str, Any]:
    y = known.moving[partition]
    alike = random.random() < 0.8  # with the other partitions
    phase = known.step if alike else random.randrange(8)
    _array(request, "displacement", 0.002 * np.stack([np.sin(phase + y), np.cos(phase * y)], axis=1))
    more: dict[str, Any] = {"time": known.step + 1.0, "velocity": ("", "bdf1", "tangent")[known.step % 3]}
    if more["velocity"] == "tangent":
        _array(request, "boundary_velocity", np.stack([y, 1.0 - y], axis=1))
    if random.random() < 0.3:
        ways = ("step", "displacement", "velocity")[: 3 if more["velocity"] else 2]
        more |= {"report": "headroom", "headroom_along": random.choice(ways)}
    elif random.random() < 0.4:
        more["report"] = "swept"
        if random.random() < 0.5:
            _array(request, "swept_faces", np.array([[0, 1], [1, 2], [2, 0]]))
    return {"step": known.step + 1, "frame": "committed" if alike else "reference"} | more


def _tangent(request: Request, known: Known, partition: int, random: Random) -> dict[str, Any]:
    y = known.moving[partition]
    _array(request, "velocity", np.stack([np.sin(y), np.cos(y)], axis=1))
    return {"what": random.choice(("trial", "committed"))}


def _cotangent(request: Request, known: Known, partition: int, random: Random) -> dict[str, Any]:
    _array(request, "weights", shared_mesh(known.partitions)[partition].points / 3)
    return {"what": random.choice(("trial", "committed"))}


def _judge(request: Request, known: Known, _partition: int, _random: Random) -> dict[str, Any]:
    _array(request, "bins", np.array([[0, 1536, 18]]))
    _array(request, "values", np.array([[0.0, 0.5, 18.0]]))
    _array(request, "worst", np.array([[1.0, 0.0, 0.5, 0.5, 1.0, 0.5, 0.0, 0.0]]))
    part = {"cells": 18, "inverted": 0, "sums": {"size": 9.0}, "minima": {"size": 0.5}}
    return {"step": known.step + 1, "part": part, "questions": [{"metric": "size", "way": []}]}


def _correct(request: Request, known: Known, _partition: int, random: Random) -> dict[str, Any]:
    _array(request, "nodes", np.array([[0, 1], [1, 0], [2, 1]]))
    for name in ("points", "positions"):
        _array(request, name, np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))
    _array(request, "corners", np.array([[0], [1], [2]]))
    region = {"metric": "size", "below": 0.2, "rings": 4, "cells": {"triangle": 1}, "interior": 0, "least": [1.0, 1.0]}
    return {"step": known.step + 1, "what": random.choice(("trial", "committed")), "part": region}


_More = Callable[[Request, Known, int, Random], dict[str, Any]]
#: Fields in addition to the address, by type.
_MORE: Mapping[str, _More] = {
    "HELLO": lambda *_: {"versions": [[1, 0]], "features": [], "agent": "fuzz"},
    "OPEN": _open,
    "RESUME": _address,
    "PROBE": _address,
    "LIST": lambda *_: {"after": ""},
    "JOIN": lambda _r, known, _p, _: {"token": known.token},
    "UPLOAD": _upload,
    "MOVE": _move,
    "TANGENT": _tangent,
    "COTANGENT": _cotangent,
    "JUDGE": _judge,
    "CORRECT": _correct,
    "COMMIT": lambda _r, known, _p, _: {"step": known.step + 1, "time": known.step + 1.0},
    "ROLLBACK": lambda _r, known, _p, _: {"step": known.step + 1},
    "FETCH": lambda _r, _k, _p, random: {"what": random.choice(("committed", "reference"))},
    "CLOSE": lambda *_: {"outcome": "keep"},
}
