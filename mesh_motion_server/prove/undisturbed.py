"""A coupled run of two partitions that nothing disturbs, in this process: what every disturbed one is compared with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from mesh_motion_protocol.codec import encode
from mesh_motion_protocol.messages import Commit, Fetch, Message, Move
from numpy.typing import NDArray

from mesh_motion_server.prove.check import require
from mesh_motion_server.prove.driver import make_driver
from mesh_motion_server.prove.model_files import ModelFiles
from mesh_motion_server.prove.stand_in import grid_mesh, split_mesh
from mesh_motion_server.session.store import SessionStore

__all__ = ["PARTITIONS", "Step", "Undisturbed", "committer", "frames_of"]

Floats = NDArray[np.float64]

PARTITIONS = 2


def committer(partition: int) -> bytes:
    """The client of a partition's COMMITs: their sequence numbers are the steps, in every run alike."""
    return b"the committer %02d" % partition


def frames_of(message: Message) -> bytes:
    """A message as it goes over the wire."""
    return b"".join(bytes(frame) for frame in encode(message))


@dataclass(frozen=True, eq=False)
class Step:
    """One step of the run, by partition.

    Attributes
    ----------
    given : list of (k, d) array, mesh length unit
        Displacements of the moving nodes.
    displacements, points : list of (n, d) array, mesh length unit
        Of all nodes, and where they are once it is committed.
    replies : list of bytes
        The frames of COMMITTED.
    """

    given: list[Floats]
    displacements: list[Floats]
    points: list[Floats]
    replies: list[bytes]


class Undisturbed:
    """The run, as far as it was asked for.

    Attributes
    ----------
    meshes : list of PartitionMesh
    """

    def __init__(self) -> None:
        self.meshes = split_mesh(grid_mesh(), PARTITIONS)
        self._driver = make_driver(SessionStore("/undisturbed", files=ModelFiles()), self.meshes)
        self._driver.open()
        self._steps: list[Step] = []

    def step(self, number: int) -> Step:
        """Step 1, 2, …"""
        while len(self._steps) < number:
            self._steps.append(self._next(len(self._steps) + 1))
        return self._steps[number - 1]

    def points(self, number: int) -> list[Floats]:
        """Coordinates (n, d) after so many steps, by partition."""
        return self.step(number).points if number else [mesh.points for mesh in self.meshes]

    def given(self, number: int) -> list[Floats]:
        """To and fro, so that the mesh is as good after many steps; each step's own, and back in the next."""
        sign = 1 if number % 2 else -1
        return [0.01 * sign * rows for rows in self._driver.displacement((number + 1) // 2)]

    def _next(self, number: int) -> Step:
        given, partitions = self.given(number), range(PARTITIONS)
        moved = self._driver.all(Move, given, step=number)
        replies: list[Any] = []
        for p in partitions:
            commit = self._driver.request(Commit, p, client=committer(p), sequence=number, step=number)
            replies += self._driver.send(commit)
        require(all(reply.type == "COMMITTED" for reply in replies), f"the undisturbed run fails: {replies}")
        points = [self._driver.ask(Fetch, p).points for p in partitions]
        return Step(given, [reply.displacement for reply in moved], points, [frames_of(reply) for reply in replies])
