"""A small mesh and a tiny model, so that sessions are tested without the compiled numerics."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from mesh_motion_protocol.messages import Build, Commit, Join, Move, SessionMessage, Upload

from mesh_motion_server.errors import InvalidInput, NumericalError
from mesh_motion_server.numerics.cells import CellTable
from mesh_motion_server.numerics.method import Method
from mesh_motion_server.numerics.roles import BoundaryRoles, Patch
from mesh_motion_server.prove import model_files
from mesh_motion_server.service.dispatch import Envelope, SessionHost
from mesh_motion_server.session.partitions import PartitionMesh
from mesh_motion_server.session.spec import SessionSpec

TOKEN = bytes(range(32))
SESSION = "0123456789abcdef" * 2


@dataclass(frozen=True)
class Correction:
    """What the stand-in's motion says about its correction."""

    method: str = "none"
    enrichment_points: Any = ()
    freed_nodes: int = 0
    iterations: int = 0


class StandIn:
    """Inverse-distance interpolation: a pure function that depends on node order only through the sums' order."""

    def __init__(self, points: Any, cells: CellTable, patches: Mapping[str, Patch], method: Method) -> None:
        self.points, self.cells = points, cells
        self.roles = BoundaryRoles.from_patches(patches)
        self.method = replace(method, support_radius=method.support_radius or 1.0)
        self.warnings: tuple[str, ...] = ()
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

    def summary(self, points: Any) -> Any:
        """Areas as quality."""
        areas = self._areas(points)
        values = SimpleNamespace(
            min=areas.min(), mean=areas.mean(), p1=areas.min(), p5=areas.min(), p50=float(np.median(areas))
        )
        worst = [
            SimpleNamespace(number=int(c), centre=(0.0, 0.0), value=areas[c], size=areas[c], skew=1.0, size_skew=1.0)
            for c in np.argsort(areas, kind="stable")[:3]
        ]
        return SimpleNamespace(
            size=values, skew=values, size_skew=values, metric=values, worst=worst,
            inverted=int((areas <= 0).sum()), cells=len(areas),
        )  # fmt: skip

    def move(self, committed: Any, targets: Any, factors: Any) -> Any:
        """Spread the boundary's displacement by inverse distance squared."""
        moving = self.roles.moving
        held = np.union1d(moving, self.roles.fixed)
        key = hashlib.sha256(committed.tobytes()).digest()
        weights, reused = factors.get_or_make(key, lambda: self._weights(committed, held))
        told = np.zeros((len(committed), committed.shape[1]))
        told[moving] = targets - committed[moving]
        points = committed + weights @ told[held]
        points[moving] = targets
        points[self.roles.fixed] = committed[self.roles.fixed]
        summary = self.summary(points)
        if summary.inverted:
            cells = [int(c) for c in np.argsort(self._areas(points), kind="stable")[: summary.inverted]]
            raise NumericalError("no valid mesh found", best=float(summary.metric.min), cells=cells, fraction=0.25)
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
    """Cells dealt out at random; every partition numbers its nodes in an order of its own."""
    random = np.random.default_rng(seed)
    cells = whole.cells["triangle"]
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


def make_spec(session: str = SESSION, **changes: Any) -> SessionSpec:
    """A spec of a 2D session."""
    return SessionSpec(session=session, token=TOKEN, dimension=2, **changes)


class Driver:
    """Speaks to a host as the solver's ranks would; every partition is a client of its own.

    ``replies``: what the last request of each partition was answered with.
    """

    def __init__(self, host: SessionHost, meshes: list[PartitionMesh]) -> None:
        self.host, self.meshes = host, meshes
        self.sequences = [0] * len(meshes)
        self.moving = [np.unique(m.patches["left"].nodes) if "left" in m.patches else np.empty(0, int) for m in meshes]

    def request(self, kind: type[SessionMessage], partition: int = 0, **fields: Any) -> Any:
        """A new request of a partition."""
        self.sequences[partition] += 1
        known = {
            "client": bytes([partition + 1]) * 16,
            "sequence": self.sequences[partition],
            "session": self.host.session,
            "epoch": self.host.epoch,
            "partition": partition,
        }
        return kind(**known | fields)

    def send(self, request: Any, peer: bytes | None = None) -> list[Any]:
        """The replies, as (partition's peer, message) → messages."""
        envelopes = self.host.handle(Envelope(peer or b"peer %d" % request.partition, request))
        return [envelope.message for envelope in envelopes]

    def ask(self, kind: type[SessionMessage], partition: int = 0, **fields: Any) -> Any:
        """One request, its one reply."""
        (reply,) = self.send(self.request(kind, partition, **fields))
        return reply

    def all(self, kind: type[SessionMessage], rows: Any = None, **fields: Any) -> list[Any]:
        """A collective request of every partition; the replies by partition."""
        replies: list[Any] = []
        for p in range(len(self.meshes)):
            own = {} if rows is None else {"displacement": rows[p]}
            replies += self.send(self.request(kind, p, **fields | own))
        return replies

    def join(self) -> Any:
        """Every partition joins; the last reply."""
        return [self.ask(Join, p, token=TOKEN) for p in range(len(self.meshes))][-1]

    def upload(self) -> None:
        """Every partition's mesh."""
        for p, mesh in enumerate(self.meshes):
            parts: list[tuple[str, str, str, Any]] = [("nodes", "", "", mesh.points)]
            parts += [("global_ids", "", "", mesh.global_ids[:, None])]
            parts += [("cells", name, "", nodes) for name, nodes in mesh.cells.items()]
            parts += [("patch", name, patch.role, patch.nodes[:, None]) for name, patch in mesh.patches.items()]
            for item, name, role, rows in parts:
                reply = self.ask(Upload, p, item=item, name=name, role=role, rows=rows)
                assert reply.type == "UPLOADED", reply

    def displacement(self, step: int) -> list[Any]:
        """A smooth motion of the left side that depends on the step."""
        rows = []
        for mesh, moving in zip(self.meshes, self.moving, strict=True):
            y = mesh.points[moving, 1]
            rows.append(0.01 * np.stack([np.sin(step + y), np.cos(step * y)], axis=1))
        return rows

    def open(self) -> list[Any]:
        """From NEW to READY."""
        self.join()
        self.upload()
        return self.all(Build)

    def move(self, step: int, **fields: Any) -> list[Any]:
        """The motion of this step."""
        return self.all(Move, self.displacement(step), step=step, **fields)

    def advance(self, step: int) -> list[Any]:
        """Move and commit."""
        moved = self.move(step)
        assert moved[-1].type == "MOVED", moved[-1]
        return self.all(Commit, step=step)


def make_driver(store: Any, meshes: list[PartitionMesh], **options: Any) -> Driver:
    """A driver of a new session."""
    spec = make_spec(options.pop("session", SESSION), partitions=len(meshes), **options.pop("spec", {}))
    return Driver(SessionHost.create(spec, store, build_model=StandIn, **options), meshes)


def resume(store: Any, session: str = SESSION, **options: Any) -> SessionHost:
    """A stored session in another process."""
    return SessionHost.resume(session, TOKEN, store, build_model=StandIn, **options)


def resume_driver(driver: Driver, store: Any, **options: Any) -> Driver:
    """The same ranks with their request numbers, after the session was resumed in another process."""
    again = Driver(resume(store, driver.host.session, **options), driver.meshes)
    again.sequences = driver.sequences
    again.join()
    return again


@pytest.fixture
def kit() -> SimpleNamespace:
    """The builders of this module: test modules cannot import it."""
    return SimpleNamespace(
        StandIn=StandIn,
        grid_mesh=grid_mesh,
        split_mesh=split_mesh,
        make_spec=make_spec,
        TOKEN=TOKEN,
        SESSION=SESSION,
        files=model_files,
        make_driver=make_driver,
        resume=resume,
        resume_driver=resume_driver,
        Driver=Driver,
        Envelope=Envelope,
        Join=Join,
    )
