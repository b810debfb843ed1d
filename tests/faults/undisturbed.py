"""An undisturbed coupled run in this process, the reference for all disturbed runs."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from mesh_motion_protocol.codec import encode
from mesh_motion_protocol.messages import Commit, Fetch, Message, Move
from numpy.typing import NDArray

from mesh_motion_server.session.partitions.meshes import PartitionMesh
from tests.faults.check import require
from tests.faults.driver import Driver, undisturbed_driver

Floats = NDArray[np.float64]


def committer(partition: int) -> bytes:
    """The client of a partition's COMMITs: their sequence numbers are the steps, in every run alike."""
    return b"the committer %02d" % partition


def frames_of(message: Message) -> bytes:
    return b"".join(bytes(frame) for frame in encode(message))


def to_and_fro(driver: Driver, number: int, factor: float = 1.0) -> list[Floats]:
    """Displacement so small that the mesh stays as good after ten thousand steps; each step has its own, and the next
    step undoes it.
    """
    sign = 0.01 if number % 2 else -0.01
    return [sign * factor * rows for rows in driver.displacement((number + 1) // 2)]


@dataclass(frozen=True, eq=False)
class Step:
    """One step of the run.

    ``given`` (list of list of (k, d) array, mesh length unit): displacements of the moving nodes, by move and
    partition; ``displacements`` (list of list of (n, d) array, mesh length unit): of all nodes, by move and partition;
    ``points`` (list of (n, d) array, mesh length unit): where they are once it is committed, by partition; ``digest``:
    of that state; ``replies``: the frames of COMMITTED, by partition.
    """

    given: list[list[Floats]]
    displacements: list[list[Floats]]
    points: list[Floats]
    digest: bytes
    replies: list[bytes]


class Undisturbed:
    """The run up to the last requested step.

    ``moves``: the MOVEs of a step, as factors of its motion.
    """

    def __init__(self, meshes: list[PartitionMesh], moves: Sequence[float] = (1.0,)) -> None:
        self.meshes, self._moves = meshes, moves
        self._driver = undisturbed_driver(meshes)
        self._steps: list[Step] = []

    def step(self, number: int) -> Step:
        """Step 1, 2, …"""
        while len(self._steps) < number:
            self._steps.append(self._next(len(self._steps) + 1))
        return self._steps[number - 1]

    def points(self, number: int) -> list[Floats]:
        """Coordinates (n, d) by partition after this number of steps."""
        return self.step(number).points if number else [mesh.points for mesh in self.meshes]

    def _next(self, number: int) -> Step:
        given, partitions = [to_and_fro(self._driver, number, f) for f in self._moves], range(len(self.meshes))
        moved = [[reply.displacement for reply in self._driver.all(Move, rows, step=number)] for rows in given]
        replies: list[Any] = []
        for p in partitions:
            commit = self._driver.request(Commit, p, client=committer(p), sequence=number, step=number)
            replies += self._driver.send(commit)
        require(all(reply.type == "COMMITTED" for reply in replies), f"the undisturbed run fails: {replies}")
        points = [self._driver.ask(Fetch, p).points for p in partitions]
        return Step(given, moved, points, replies[0].digest, [frames_of(reply) for reply in replies])
