"""The cost of derivatives and of the headroom: ``python -m benchmarks.derivatives MESH FOLDER REPEAT`` prints JSON.

Compares them with a step of the same motion in the same process: small steps without a correction, the same
steps with the default method (its correction has nothing to do), and larger steps until the correction frees nodes. A
state is prepared once, for its first vector.
"""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from mesh_motion_numerics.method import Method

from benchmarks.peers.meshes import load_or_build
from benchmarks.peers.motions import MOTIONS
from benchmarks.peers.task import Task
from benchmarks.scale.cases import MESHES
from benchmarks.scale.figures import Seconds, timed
from benchmarks.scale.library import model_of
from mesh_motion_server.session.factors import FactorCache

__all__ = ["DerivativeCost", "measured"]

#: Parts of the large motion: without a correction, and with one.
_SMALL, _LARGE = 50, 8
_CACHE_BYTES = 2**31


@dataclass(frozen=True)
class DerivativeCost:
    """Cost on one mesh: the shortest of the small steps, the last of the large ones, and the shortest time of a vector.

    Attributes
    ----------
    freed : int
        Nodes that the correction has freed.
    plain_step, plain_prepared, plain_tangent, plain_cotangent, plain_headroom : Seconds
        Without a correction.
    idle_step, idle_prepared, idle_tangent, idle_cotangent, idle_headroom : Seconds
        The same steps by the default method: no node is freed.
    step, prepared, tangent, cotangent, headroom : Seconds
        With freed nodes.
    """

    freed: int
    plain_step: Seconds
    plain_prepared: Seconds
    plain_tangent: Seconds
    plain_cotangent: Seconds
    plain_headroom: Seconds
    idle_step: Seconds
    idle_prepared: Seconds
    idle_tangent: Seconds
    idle_cotangent: Seconds
    idle_headroom: Seconds
    step: Seconds
    prepared: Seconds
    tangent: Seconds
    cotangent: Seconds
    headroom: Seconds

    @classmethod
    def read(cls, found: dict[str, object]) -> DerivativeCost:
        """From JSON."""
        return cls(**{k: Seconds(**v) if isinstance(v, dict) else v for k, v in found.items()})  # type: ignore[arg-type]


def measured(mesh: str, folder: Path, repeat: int) -> DerivativeCost:
    """The cost on one of the meshes of :mod:`.scale`."""
    plain = Method(correction="none", displacement="absolute")
    _, of_plain = _cost(mesh, folder, repeat, "plain_", plain)
    _, of_idle = _cost(mesh, folder, repeat, "idle_", Method())
    freed, smooth = _cost(mesh, folder, repeat, "", Method(), freeing=True)
    return DerivativeCost(freed, **of_plain, **of_idle, **smooth)


def _cost(
    mesh: str, folder: Path, repeat: int, prefix: str, method: Method, *, freeing: bool = False
) -> tuple[int, dict[str, Seconds]]:
    """The cost after ``repeat`` small steps, or after large steps until the correction frees nodes."""
    parts = _LARGE if freeing else _SMALL
    built = load_or_build(mesh, folder)
    body = built.points[built.moving]
    displacements = MOTIONS[MESHES[mesh]].displacements(body, parts)
    task = Task(built.points, built.cells, built.moving, built.fixed, displacements)
    task = replace(task, cells={name: nodes.astype(np.int32) for name, nodes in task.cells.items()})
    model, factors, points = model_of(task, method), FactorCache(_CACHE_BYTES), built.points
    steps = []
    for part in range(parts):
        targets = task.targets(part)
        step, motion = timed(partial(model.move, points, targets, factors))
        steps.append(step)
        before, points = points, motion.points
        if motion.correction.freed_nodes if freeing else part + 1 == repeat:
            break
    prepared, slope = timed(lambda: model.slope(points, factors))
    numbers = np.random.default_rng(1)
    velocity, weights = numbers.standard_normal(body.shape), numbers.standard_normal(points.shape)
    worst = np.array([cell.number for cell in motion.corrected.worst])
    calls = {
        "tangent": lambda: slope.tangent(velocity),
        "cotangent": lambda: slope.cotangent(weights),
        "headroom": lambda: model.headroom(before, points, worst),
    }
    found = {name: Seconds.shortest([timed(call)[0] for _ in range(repeat)]) for name, call in calls.items()}
    found |= {"step": step if freeing else Seconds.shortest(steps), "prepared": prepared}
    return motion.correction.freed_nodes, {prefix + name: seconds for name, seconds in found.items()}


def main(arguments: list[str]) -> None:
    """Run the command line that the module's docstring describes."""
    mesh, folder, repeat = arguments
    print(json.dumps(asdict(measured(mesh, Path(folder), int(repeat)))))


if __name__ == "__main__":
    main(sys.argv[1:])
