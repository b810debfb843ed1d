"""Valid requests of a session, the start of a fuzz."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from random import Random
from typing import Any

import numpy as np
from mesh_motion_protocol.messages import MESSAGES, Message

from mesh_motion_server.session.partitions.meshes import PartitionMesh
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
_FRAMES = ("committed", "reference")
_TRIANGLE = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])


@dataclass
class Known:
    """A client's knowledge of its session.

    ``sequence``: the last used number.
    """

    session: str
    token: bytes
    epoch: int
    partitions: int
    step: int = 0
    sequence: int = 0
    meshes: list[PartitionMesh] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.meshes = shared_mesh(self.partitions)

    def uploads(self, partition: int) -> list[dict[str, Any]]:
        return [{"name": "", "role": ""} | part for part in uploads_of(self.meshes[partition], self.partitions)]

    def heights(self, partition: int) -> Any:
        """(k,) numbers of a partition's moving nodes."""
        mesh = self.meshes[partition]
        return mesh.points[np.sort(mesh.patches["left"].nodes), 1]


def valid_request(kind: str, known: Known, partition: int, random: Random, **fields: Any) -> Message:
    """A request of a partition that fits the session, if its state allows the request; these fields replace drawn
    ones.
    """
    known.sequence += 1
    about: dict[str, Any] = {"client": bytes([partition + 1]) * 16, "sequence": known.sequence}
    if kind in DATA and kind != "PING":
        about |= {"session": known.session, "epoch": known.epoch, "partition": partition}
    if kind in _MORE:
        about |= _MORE[kind](known, partition, random)
    return MESSAGES[kind](**about | fields)


def _open(_known: Known, _partition: int, random: Random) -> dict[str, Any]:
    return {"dimension": random.choice((1, 2, 3)), "partitions": random.choice((1, 2, 256)), "label": "a label",
            "settings": dict(random.choice(_SETTINGS)), "bytes_reserved": 1000, "durability": "",
            "time": -1.5, "time_levels": random.choice(("", "bdf2", "bossak"))}  # fmt: skip


def _address(known: Known, _partition: int, _random: Random) -> dict[str, Any]:
    return {"session": known.session, "token": known.token}


def _move(known: Known, partition: int, random: Random) -> dict[str, Any]:
    y, alike = known.heights(partition), random.random() < 0.8  # with the other partitions
    phase = known.step if alike else random.randrange(8)
    rows = 0.002 * np.stack([np.sin(phase + y), np.cos(phase * y)], axis=1)
    more: dict[str, Any] = {"time": known.step + 1.0, "velocity": ("", "bdf1", "tangent")[known.step % 3]}
    if more["velocity"] == "tangent":
        more["boundary_velocity"] = np.stack([y, 1.0 - y], axis=1)
    if random.random() < 0.3:
        ways = ("step", "displacement", "velocity")[: 3 if more["velocity"] else 2]
        more |= {"report": "headroom", "headroom_along": random.choice(ways)}
    elif random.random() < 0.4:
        more["report"] = "swept"
        more |= {"swept_faces": np.array([[0, 1], [1, 2], [2, 0]])} if random.random() < 0.5 else {}
    return {"step": known.step + 1, "frame": "committed" if alike else "reference", "displacement": rows} | more


def _tangent(known: Known, partition: int, random: Random) -> dict[str, Any]:
    y = known.heights(partition)
    return {"what": random.choice(("trial", "committed")), "velocity": np.stack([np.sin(y), np.cos(y)], axis=1)}


def _cotangent(known: Known, partition: int, random: Random) -> dict[str, Any]:
    return {"what": random.choice(("trial", "committed")), "weights": known.meshes[partition].points / 3}


def _judge(known: Known, _partition: int, _random: Random) -> dict[str, Any]:
    part = {"cells": 18, "inverted": 0, "sums": {"size": 9.0}, "minima": {"size": 0.5}}
    arrays = {"bins": np.array([[0, 1536, 18]]), "values": np.array([[0.0, 0.5, 18.0]]),
              "worst": np.array([[1.0, 0.0, 0.5, 0.5, 1.0, 0.5, 0.0, 0.0]])}  # fmt: skip
    return {"step": known.step + 1, "part": part, "questions": [{"metric": "size", "way": []}]} | arrays


def _correct(known: Known, _partition: int, random: Random) -> dict[str, Any]:
    region = {"metric": "size", "below": 0.2, "rings": 4, "cells": {"triangle": 1}, "interior": 0, "least": [1.0, 1.0]}
    arrays = {"nodes": np.array([[0, 1], [1, 0], [2, 1]]), "points": _TRIANGLE, "positions": _TRIANGLE,
              "corners": np.array([[0], [1], [2]])}  # fmt: skip
    return {"step": known.step + 1, "what": random.choice(("trial", "committed")), "part": region} | arrays


_More = Callable[[Known, int, Random], dict[str, Any]]
#: Fields in addition to the address, by type.
_MORE: Mapping[str, _More] = {
    "HELLO": lambda *_: {"versions": [[1, 0]], "features": [], "agent": "fuzz"},
    "OPEN": _open,
    "RESUME": _address,
    "PROBE": _address,
    "LIST": lambda *_: {"after": ""},
    "JOIN": lambda known, *_: {"token": known.token},
    "UPLOAD": lambda known, partition, random: random.choice(known.uploads(partition)),
    "MOVE": _move,
    "TANGENT": _tangent,
    "COTANGENT": _cotangent,
    "JUDGE": _judge,
    "CORRECT": _correct,
    "COMMIT": lambda known, *_: {"step": known.step + 1, "time": known.step + 1.0},
    "ROLLBACK": lambda known, *_: {"step": known.step + 1},
    "FETCH": lambda _k, _p, random: {"what": random.choice(_FRAMES)},
    "CLOSE": lambda *_: {"outcome": "keep"},
}
