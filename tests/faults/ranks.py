"""The ranks of a solver, their rivals and their mesh: they turn an action into a request."""

from dataclasses import replace
from typing import Any

import numpy as np
from mesh_motion_protocol import messages as wire
from numpy.typing import NDArray

from mesh_motion_server.session.partitions.meshes import PartitionMesh
from tests.faults.actions import Action
from tests.faults.expected import Asked, Share
from tests.faults.session_model import SessionModel
from tests.faults.stand_in import grid_mesh

#: Those who are not the session's owner, and their clients.
OTHERS = {name: bytes([200 + i]) * 16 for i, name in enumerate(("stranger", "monitor", "admin", "unlisted"))}
_OWNER = b"c" * 16
_ELSEWHERE = "f" * 32
#: Mesh length unit: so little that a mesh moved a hundred times is still valid.
_AMPLITUDE = 0.004
#: The additional fields of a MOVE; each rank chooses its own.
_HEADROOMS: tuple[dict[str, str], ...] = (
    {},
    {"report": "headroom"},
    {"report": "headroom", "headroom_along": "displacement"},
)


def shared_mesh(partitions: int) -> list[PartitionMesh]:
    """A square of 4 × 4 nodes cut into horizontal strips, whose moving left sides share nodes."""
    whole = grid_mesh(4)
    if partitions == 1:
        return [whole]
    cells = whole.cells["triangle"]
    heights = whole.points[cells].mean(axis=1)[:, 1]
    owner = np.minimum((heights * partitions).astype(int), partitions - 1)
    return [_part(whole, cells[owner == p]) for p in range(partitions)]


def _part(whole: PartitionMesh, cells: NDArray[np.int64]) -> PartitionMesh:
    """Some cells (m, 3) with the nodes and patches that they have."""
    nodes = np.unique(cells)
    patches = {
        name: replace(patch, nodes=np.flatnonzero(np.isin(nodes, patch.nodes))) for name, patch in whole.patches.items()
    }
    return PartitionMesh(whole.points[nodes], nodes, {"triangle": np.searchsorted(nodes, cells)}, patches)


def uploads_of(mesh: PartitionMesh, partitions: int) -> list[dict[str, Any]]:
    """The uploads, nodes last: a mesh with a missing part is refused."""
    parts = [{"item": "patch", "name": n, "role": p.role, "rows": p.nodes[:, None]} for n, p in mesh.patches.items()]
    parts += [{"item": "cells", "name": "triangle", "rows": mesh.cells["triangle"]}]
    parts += [{"item": "global_ids", "rows": mesh.global_ids[:, None]}] if partitions > 1 else []
    return [*parts, {"item": "nodes", "rows": mesh.points}]


class Ranks:
    """Clients of one session, which count their requests.

    ``level``: of durability.
    """

    def __init__(self, partitions: int, level: str = "full") -> None:
        self.level = level
        self._meshes = shared_mesh(partitions)
        self._uploads = [uploads_of(mesh, partitions) for mesh in self._meshes]
        self._sequences = [0] * partitions
        self._connections = [0] * partitions
        self._others = 0

    def __len__(self) -> int:
        return len(self._meshes)

    def shares(self) -> list[Share]:
        return [
            Share(mesh.global_ids, np.sort(mesh.patches["left"].nodes), mesh.points, len(uploads))
            for mesh, uploads in zip(self._meshes, self._uploads, strict=True)
        ]

    def peer(self, partition: int) -> bytes:
        return b"%d of %d" % (self._connections[partition], partition)

    def reconnect(self, partition: int) -> None:
        self._connections[partition] += 1

    def control(self, kind: Any, action: Action, **fields: Any) -> Asked:
        """A request to the control endpoint, from the owner unless the twist names another user."""
        self._others += 1
        user = action.twist if action.twist in OTHERS else "owner"
        message = kind(client=OTHERS.get(user, _OWNER), sequence=self._others, **fields)
        return Asked(message.type, user, b"control", message)

    def about(self, kind: Any, action: Action, model: SessionModel) -> Asked:
        token = bytes(32) if action.twist == "token" else model.token
        return self.control(kind, action, session=model.session, token=token)

    def request(self, action: Action, model: SessionModel) -> Asked | None:
        """The request to the data endpoint for an action; None if it makes no sense now."""
        p, twist, kind = action.partition, action.twist, action.operation
        if twist in ("again", "other"):
            return self._repeat(action, model)
        user = twist if twist in OTHERS else "owner"
        message = wire.MESSAGES[kind](
            client=OTHERS.get(user, bytes([p + 1]) * 16),
            sequence=self._next_sequence(user, p),
            **{
                "session": _ELSEWHERE if twist == "session" else model.session,
                "epoch": model.epoch - (twist == "epoch"),
                "partition": p + 3 * (twist == "partition"),
                **self._fields(action, model),
            },
        )
        wrong = ("INVALID_ARGUMENT.SHAPE",) if twist == "rows" else ()
        peer = b"elsewhere" if twist == "unjoined" or user != "owner" else self.peer(p)
        return Asked(kind, user, peer, message, wrong, far=twist == "far")

    def derivative(self, kind: Any, partition: int, model: SessionModel) -> Asked:
        """TANGENT or COTANGENT of a partition at the session's step, from a separate client with its own count."""
        self._others += 1
        what = "trial" if model.state == "TRIAL" else "committed"
        given = (
            {"velocity": self._velocity(partition)} if kind is wire.Tangent else {"weights": self._weights(partition)}
        )
        address = {"session": model.session, "epoch": model.epoch, "partition": partition}
        message = kind(client=bytes([partition + 100]) * 16, sequence=self._others, what=what, **address, **given)
        return Asked(message.type, "owner", self.peer(partition), message)

    def paired(self, found: list[Any]) -> float:
        """Σ w · (J v), or Σ (Jᵀ w) · v, of the replies of all partitions in their order.

        The weights that partitions give to a node are added, so all of their nodes count; but a moving node once.
        """
        if found[0].type == "TANGENT_FOUND":
            return float(sum(np.sum(self._weights(p) * reply.velocity) for p, reply in enumerate(found)))
        once = {
            int(node): float(weights @ velocity)
            for p, reply in enumerate(found)
            for node, weights, velocity in zip(self._moving(p), reply.weights, self._velocity(p), strict=True)
        }
        return sum(once.values())

    def _moving(self, partition: int) -> NDArray[np.int64]:
        """(k,) global numbers of the moving nodes."""
        mesh = self._meshes[partition]
        return mesh.global_ids[np.sort(mesh.patches["left"].nodes)]

    def _velocity(self, partition: int) -> NDArray[np.float64]:
        """(k, 2) vectors, the same from every partition."""
        node = self._moving(partition)
        return np.stack([np.cos(node), np.sin(3.0 * node)], axis=1)

    def _weights(self, partition: int) -> NDArray[np.float64]:
        """(n, 2) weights, different in each partition."""
        points = self._meshes[partition].points
        return np.stack([np.sin(partition + 5.0 * points[:, 1]), points[:, 0] - partition], axis=1)

    def _next_sequence(self, user: str, partition: int) -> int:
        if user != "owner":
            self._others += 1
            return self._others
        self._sequences[partition] += 1
        return self._sequences[partition]

    def _fields(self, action: Action, model: SessionModel) -> dict[str, Any]:
        kind, twist = action.operation, action.twist
        frame = "reference" if twist == "reference" else "committed"
        if kind == "JOIN":
            return {"token": bytes(32) if twist == "token" else model.token}
        if kind == "UPLOAD":
            return self._part(action, model.uploaded[action.partition])
        if kind == "MOVE":
            asked = _HEADROOMS[action.value % len(_HEADROOMS)]
            return {"step": _step(action, model), "frame": frame, "displacement": self._displacement(action)} | asked
        if kind in ("COMMIT", "ROLLBACK"):
            return {"step": _step(action, model)}
        if kind == "FETCH":
            return {"what": frame}
        return {"outcome": "discard" if twist == "discard" else "keep"} if kind == "CLOSE" else {}

    def _part(self, action: Action, known: int) -> dict[str, Any]:
        """The next part of the mesh; after the last part the cells again, which makes the mesh invalid."""
        parts = self._uploads[action.partition]
        part = parts[known] if known < len(parts) else next(x for x in parts if x["item"] == "cells")
        return part | ({"rows": part["rows"][:, [0] * 7]} if action.twist == "rows" else {})

    def _displacement(self, action: Action) -> NDArray[np.float64]:
        """(k, 2) displacement: small, across the whole mesh, or with one row too many."""
        mesh = self._meshes[action.partition]
        y = mesh.points[np.sort(mesh.patches["left"].nodes), 1]
        if action.twist == "rows":
            y = np.append(y, 0.0)
        rows = _AMPLITUDE * np.stack([np.sin(action.value + y), np.cos(action.value * (1 + y))], axis=1)
        return rows + np.array([3.0, 0.0]) if action.twist == "far" else rows

    def _repeat(self, action: Action, model: SessionModel) -> Asked | None:
        """An earlier request of this kind from the partition, or its number with other content."""
        book, waiting = model.book(bytes([action.partition + 1]) * 16), model.waiting.get(action.partition)
        entries = [entry for entry in book.entries if entry.kind == action.operation and book.is_clear(entry)]
        if entries:
            entry = entries[-1 - action.value % len(entries)]
            earlier: Asked = entry.asked
            strict = entry.executed and entry.known
        elif waiting and waiting.kind == action.operation:
            earlier, strict = waiting, True
        else:
            return None
        message = replace(earlier.message, epoch=model.epoch)
        if action.twist == "other":
            if not strict:
                return None  # refused or forgotten: SPEC.md does not say how long its content is known
            message = _with_other_content(message)
        return replace(earlier, kind=message.type, peer=self.peer(action.partition), message=message)


def _step(action: Action, model: SessionModel) -> int:
    return (model.step, model.step + 2, 2**62)[action.value % 3] if action.twist == "step" else model.step + 1


def _with_other_content(message: Any) -> Any:
    """The same number and address with another step, or another request altogether."""
    if hasattr(message, "step"):
        return replace(message, step=message.step + 1)
    names = ("client", "sequence", "session", "epoch", "partition")
    return wire.Rollback(step=1, **{name: getattr(message, name) for name in names})
