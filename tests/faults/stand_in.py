"""A small mesh and a tiny model, so that sessions are tested without the compiled numerics."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.roles import BoundaryRoles, Patch
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.quality.headroom import Headroom
from mesh_motion_numerics.quality.quality_summary import Distribution, QualitySummary, WorstCell
from mesh_motion_protocol.errors import InvalidInput, QualityRefused

from mesh_motion_server.session.partitions.meshes import PartitionMesh

#: As SPEC.md's section 13 has it for the longest side: the squares of larger ones overflow.
_FARTHEST = 1e30


@dataclass(frozen=True)
class Correction:
    """The stand-in's report of its correction."""

    method: str = "none"
    enrichment_points: Any = ()
    freed_nodes: int = 0
    iterations: int = 0


class StandIn:
    """Inverse-distance interpolation: a pure function that depends on node order only through the order of sums."""

    def __init__(self, points: Any, cells: CellTable, patches: Mapping[str, Patch], method: Method) -> None:
        self.points, self.cells = points, cells
        self.roles = BoundaryRoles.from_patches(patches)
        self.method = replace(method, support_radius=method.support_radius or 1.0)
        self.warnings: tuple[str, ...] = ()
        if not np.abs(points).max() <= _FARTHEST:
            raise InvalidInput(f"coordinates beyond {_FARTHEST}", code="INVALID_ARGUMENT.MESH")
        flat = np.flatnonzero(self._areas(points) <= 0)
        if len(flat):
            raise InvalidInput(f"cell {flat[0]} is inverted", details={"cell": int(flat[0])})

    def _areas(self, points: Any) -> Any:
        areas = []
        for block in self.cells:
            x = points[block.nodes[:, :3]]
            a, b = x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]
            areas.append(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
        return np.concatenate(areas)

    def summary(self, points: Any) -> QualitySummary:
        areas = self._areas(points)
        least = float(areas.min())
        values = Distribution(least, float(areas.mean()), least, least, float(np.median(areas)))
        worst = tuple(
            WorstCell(int(c), (0.0, 0.0), float(areas[c]), float(areas[c]), 1.0, 1.0)
            for c in np.argsort(areas, kind="stable")[:3]
        )
        inverted = int((areas <= 0).sum())
        return QualitySummary(values, values, values, values, inverted, len(areas), worst)

    def headroom(self, before: Any, points: Any, worst: Any, *, step: bool = True) -> Headroom:
        """None of its meshes ends."""
        return Headroom(math.inf, math.inf, 0)

    def why_no_slope(self) -> None:
        """Returns None: the constant weights are a derivative."""

    def slope(self, points: Any, factors: Any) -> Any:
        moving = self.roles.moving
        held = np.union1d(moving, self.roles.fixed)
        weights = self._weights(self.points, held)[:, np.searchsorted(held, moving)]
        return SimpleNamespace(tangent=lambda velocity: weights @ velocity, cotangent=lambda given: weights.T @ given)

    def without_distributions(self) -> StandIn:
        """Itself: its summaries are cheap."""
        return self

    def move(self, committed: Any, targets: Any, factors: Any, *, boundary_displacement: Any = None) -> Any:
        """Spread the boundary's displacement by inverse distance squared."""
        moving = self.roles.moving
        held = np.union1d(moving, self.roles.fixed)
        key = hashlib.sha256(committed.tobytes()).digest()
        weights, reused = factors.get_or_make(key, lambda: self._weights(committed, held))
        displacement = np.zeros((len(committed), committed.shape[1]))
        displacement[moving] = targets - committed[moving]
        points = committed + weights @ displacement[held]
        points[moving] = targets
        points[self.roles.fixed] = committed[self.roles.fixed]
        summary = self.summary(points)
        if summary.inverted:
            cells = [int(c) for c in np.argsort(self._areas(points), kind="stable")[: summary.inverted]]
            raise QualityRefused("no valid mesh found", best=float(summary.metric.min), cells=cells, fraction=0.25)
        return SimpleNamespace(
            points=points,
            standard=summary,
            corrected=summary,
            correction=Correction(enrichment_points=np.zeros((0, committed.shape[1]))),
            reached=True,
            seconds={"total": 0.0},
            caches={"factorization": "reused" if reused else "made"},
            control_points=np.arange(len(committed)),
            support_radius=1.0,
            sub_steps=1,
            warnings=[],
            field=None,
        )

    @staticmethod
    def _weights(points: Any, held: Any) -> Any:
        gaps = np.sum((points[:, None] - points[None, held]) ** 2, axis=2) + 1e-3
        return (1 / gaps) / np.sum(1 / gaps, axis=1)[:, None]


def grid_mesh(count: int = 5) -> PartitionMesh:
    """Unit square of count × count nodes in triangles; left side moves, right side is fixed."""
    x, y = np.meshgrid(np.linspace(0, 1, count), np.linspace(0, 1, count))
    points = np.stack([x.ravel(), y.ravel()], axis=1)
    corner = (np.arange(count - 1)[:, None] * count + np.arange(count - 1)).ravel()
    lower = np.stack([corner, corner + 1, corner + count], axis=1)
    upper = np.stack([corner + 1, corner + count + 1, corner + count], axis=1)
    column = np.arange(count) * count
    return PartitionMesh(
        points=points,
        global_ids=np.arange(count * count),
        cells={"triangle": np.concatenate([lower, upper])},
        patches={"left": Patch("moving", column), "right": Patch("fixed", column + count - 1)},
    )


def split_mesh(whole: PartitionMesh, parts: int, seed: int = 0) -> list[PartitionMesh]:
    """Distribute cells at random; every partition numbers its nodes in its own order."""
    random = np.random.default_rng(seed)
    cells = np.asarray(whole.cells["triangle"])
    owner = random.integers(0, parts, len(cells))
    owner[:parts] = np.arange(parts)
    meshes = []
    for part in range(parts):
        own = random.permutation(np.flatnonzero(owner == part))
        nodes = random.permutation(np.unique(cells[own]))
        local = np.full(len(whole.points), -1)
        local[nodes] = np.arange(len(nodes))
        patches = {
            name: Patch(patch.role, local[np.intersect1d(patch.nodes, nodes)]) for name, patch in whole.patches.items()
        }
        meshes.append(
            PartitionMesh(
                points=whole.points[nodes],
                global_ids=whole.global_ids[nodes],
                cells={"triangle": local[cells[own]]},
                patches={name: patch for name, patch in patches.items() if len(patch.nodes)},
            )
        )
    return meshes
