"""Sends requests to a session's host like the ranks of a solver, without a socket."""

from collections.abc import Callable
from typing import Any

import numpy as np
from mesh_motion_protocol.messages import Build, Commit, Join, Move, SessionMessage, Upload

from mesh_motion_server.service.dispatch import SessionHost
from mesh_motion_server.service.envelope import Envelope
from mesh_motion_server.session.partitions.meshes import PartitionMesh
from mesh_motion_server.session.spec import SessionSpec
from mesh_motion_server.session.store import SessionStore
from tests.faults.check import require
from tests.faults.model_files import ModelFiles
from tests.faults.stand_in import StandIn

TOKEN = bytes(range(32))
SESSION = "0123456789abcdef" * 2

#: A model in all that a session asks of it, if not in its types.
_BUILD_MODEL: Any = StandIn


def make_spec(session: str = SESSION, **changes: Any) -> SessionSpec:
    """A spec of a 2D session."""
    return SessionSpec(session=session, token=TOKEN, dimension=2, **changes)


class Driver:
    """Sends requests to a host like the solver's ranks; every partition is a separate client.

    ``replies``: replies to the last request of each partition.
    """

    def __init__(self, host: SessionHost, meshes: list[PartitionMesh]) -> None:
        self.host, self.meshes = host, meshes
        self.sequences = [0] * len(meshes)
        self.moving = [np.unique(m.patches["left"].nodes) if "left" in m.patches else np.empty(0, int) for m in meshes]

    def request(self, kind: Callable[..., SessionMessage], partition: int = 0, **fields: Any) -> Any:
        self.sequences[partition] += 1
        known = {
            "client": bytes([partition + 1]) * 16,
            "sequence": self.sequences[partition],
            "session": self.host.session,
            "epoch": self.host.epoch,
            "partition": partition,
        }
        increment = {"frame": "committed"} if kind is Move else {}
        return kind(**known | increment | fields)

    def send(self, request: Any, peer: bytes | None = None) -> list[Any]:
        """The replies, as (partition's peer, message) → messages."""
        envelopes = self.host.handle(Envelope(peer or b"peer %d" % request.partition, request))
        return [envelope.message for envelope in envelopes]

    def ask(self, kind: Callable[..., SessionMessage], partition: int = 0, **fields: Any) -> Any:
        (reply,) = self.send(self.request(kind, partition, **fields))
        return reply

    def all(self, kind: Callable[..., SessionMessage], rows: Any = None, **fields: Any) -> list[Any]:
        """A collective request of every partition; the replies by partition."""
        replies: list[Any] = []
        for p in range(len(self.meshes)):
            own = {} if rows is None else {"displacement": rows[p]}
            replies += self.send(self.request(kind, p, **fields | own))
        return replies

    def join(self) -> Any:
        """Join with every partition; return the last reply."""
        return [self.ask(Join, p, token=TOKEN) for p in range(len(self.meshes))][-1]

    def upload(self) -> None:
        for p, mesh in enumerate(self.meshes):
            for item, name, role, rows in parts_of(mesh):
                reply = self.ask(Upload, p, item=item, name=name, role=role, rows=rows)
                require(reply.type == "UPLOADED", f"UPLOAD was answered {reply}")

    def displacement(self, step: int) -> list[Any]:
        """A smooth motion of the left side that depends on the step."""
        rows = []
        for mesh, moving in zip(self.meshes, self.moving, strict=True):
            y = mesh.points[moving, 1]
            rows.append(0.01 * np.stack([np.sin(step + y), np.cos(step * y)], axis=1))
        return rows

    def open(self) -> list[Any]:
        self.join()
        self.upload()
        return self.all(Build)

    def move(self, step: int, **fields: Any) -> list[Any]:
        return self.all(Move, self.displacement(step), step=step, **fields)

    def advance(self, step: int) -> list[Any]:
        moved = self.move(step)
        require(moved[-1].type == "MOVED", f"MOVE was answered {moved[-1]}")
        return self.all(Commit, step=step)


def parts_of(mesh: PartitionMesh) -> list[tuple[str, str, str, Any]]:
    """Uploads of a partition: item, name, role and rows."""
    parts: list[tuple[str, str, str, Any]] = [("nodes", "", "", mesh.points)]
    parts += [("global_ids", "", "", mesh.global_ids[:, None])]
    parts += [("cells", name, "", nodes) for name, nodes in mesh.cells.items()]
    return parts + [("patch", name, patch.role, patch.nodes[:, None]) for name, patch in mesh.patches.items()]


def make_driver(store: Any, meshes: list[PartitionMesh], **options: Any) -> Driver:
    spec = make_spec(options.pop("session", SESSION), partitions=len(meshes), **options.pop("spec", {}))
    return Driver(SessionHost.create(spec, store, build_model=_BUILD_MODEL, **options), meshes)


def undisturbed_driver(meshes: list[PartitionMesh]) -> Driver:
    """A driver of an open session without disturbances: its disk is the model file system's."""
    driver = make_driver(SessionStore("/undisturbed", files=ModelFiles()), meshes)
    driver.open()
    return driver


def resume(store: Any, session: str = SESSION, **options: Any) -> SessionHost:
    return SessionHost.resume(session, TOKEN, store, build_model=_BUILD_MODEL, **options)


def resume_driver(driver: Driver, store: Any, **options: Any) -> Driver:
    """The same ranks with their request numbers, after another process resumed the session."""
    again = Driver(resume(store, driver.host.session, **options), driver.meshes)
    again.sequences = driver.sequences
    again.join()
    return again
