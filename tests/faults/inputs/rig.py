"""A session host without sockets that is spoken to in frames, so that the decoder's checks are met too."""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import msgpack
import numpy as np
from mesh_motion_protocol.arrays import frames_of
from mesh_motion_protocol.codec import decode, encode
from mesh_motion_protocol.errors import MeshMotionError, ProtocolError
from mesh_motion_protocol.messages import ErrorReply, Fetched, Message, Open

from mesh_motion_server.service.dispatch import SessionHost, SessionSpec
from mesh_motion_server.service.envelope import Envelope
from mesh_motion_server.service.error_replies import error_reply
from mesh_motion_server.session.store import SessionStore
from mesh_motion_server.settings import MethodSettings, ServerSettings
from mesh_motion_server.transport.opening import check_open
from mesh_motion_server.transport.replies import undecodable
from tests.faults.inputs.drafts import Draft, Part, Rows

_TOKEN = bytes(range(32))
#: Small, so that a case can pass them.
LIMITS = ServerSettings(
    max_partitions=4, max_session_bytes=1 << 16, max_label_characters=40, durability=["full", "replay"]
)


def frames(kind: str, sequence: int, fields: dict[str, Any], arrays: dict[str, Rows]) -> list[Any]:
    """A message of any content; :func:`mesh_motion_protocol.codec.encode` would refuse most of these."""
    header = {
        "v": 1,
        "type": kind,
        "client": b"bad-inputs-rig\0\0",
        "sequence": sequence,
        "fields": fields,
        "arrays": [rows.declaration(name) for name, rows in arrays.items()],
    }
    return [msgpack.packb(header), *(frame for rows in arrays.values() for frame in frames_of(rows.values))]


@contextmanager
def quietly(noise: list[str]) -> Iterator[None]:
    """Collect warnings of libraries (numpy's of overflow, say): a checked input causes none."""
    with warnings.catch_warnings(record=True) as caught, np.errstate(all="warn", under="ignore"):
        warnings.simplefilter("always")
        yield
    noise.extend(f"{w.category.__name__}: {w.message}" for w in caught)


def opened(draft: Draft, store: SessionStore, session: str) -> Rig | ErrorReply:
    """OPEN as the server answers it: checked, then carried out in a session host."""
    request: Message | None = None
    try:
        request = decode(frames("OPEN", 1, draft.opening, {}))
        assert isinstance(request, Open)  # its header says so
        durability = check_open(request, LIMITS)
        settings = MethodSettings.from_mapping(request.settings)
        spec = SessionSpec(
            session, _TOKEN, request.dimension, request.partitions, settings, request.label, durability,
            evaluation=request.evaluation, time=float(request.time), time_levels=request.time_levels,
        )  # fmt: skip
        rig = Rig(SessionHost.create(spec, store, limits=LIMITS), request.partitions)
    except ProtocolError as error:
        return undecodable(error)
    except MeshMotionError as error:
        assert request is not None  # else the decoder has raised its own error
        return error_reply(request, error)
    for partition in range(rig.partitions):
        rig.ask("JOIN", partition, {"token": _TOKEN})
    return rig


def _over_the_wire(reply: Message) -> Message:
    """The reply as its receiver reads it."""
    return decode([bytes(frame) for frame in encode(reply)])


@dataclass
class Rig:
    """A session host and what is said to it, every partition over a connection of its own."""

    host: SessionHost
    partitions: int
    sequence: int = 0
    noise: list[str] = field(default_factory=list)

    def ask(self, kind: str, partition: int = 0, fields: dict[str, Any] | None = None, **arrays: Rows) -> list[Message]:
        """One request, all replies that it causes."""
        self.sequence += 1
        known = {"session": self.host.session, "epoch": self.host.epoch, "partition": partition}
        with quietly(self.noise):
            try:
                request = decode(frames(kind, self.sequence, known | (fields or {}), arrays))
            except ProtocolError as error:
                return [_over_the_wire(undecodable(error, state=str(self.host.state)))]
            replies = self.host.handle(Envelope(b"partition %d" % partition, request))
        return [_over_the_wire(envelope.message) for envelope in replies]

    def upload(self, part: Part, partition: int = 0) -> Message:
        """One part of the mesh."""
        (reply,) = self.ask(
            "UPLOAD", partition, {"item": part.item, "name": part.name, "role": part.role}, rows=part.rows
        )
        return reply

    def upload_all(self, draft: Draft) -> ErrorReply | None:
        """The whole mesh, up to the first part that is refused."""
        for partition, parts in enumerate(draft.parts):
            for part in parts:
                reply = self.upload(part, partition)
                if isinstance(reply, ErrorReply):
                    return reply
        return None

    def collective(self, kind: str, **fields: Any) -> list[Message]:
        """A request of every partition; the replies."""
        return [reply for p in range(self.partitions) for reply in self.ask(kind, p, fields)]

    def move(self, draft: Draft, step: int | None = None) -> list[Message]:
        """The draft's MOVE of every partition; the replies, those of an overtaken one left out."""
        replies: list[Message] = []
        for partition, rows in enumerate(draft.displacement):
            fields = {"step": draft.step if step is None else step, "frame": draft.frame} | draft.extra
            replies += self.ask("MOVE", partition, fields, displacement=rows)
        return [r for r in replies if not (isinstance(r, ErrorReply) and r.code == "ABORTED.STALE")]

    def standing(self) -> str:
        """Digest of what a partition can fetch: the committed coordinates, to the last bit."""
        digest = hashlib.sha256()
        for partition in range(self.partitions):
            (reply,) = self.ask("FETCH", partition, {"what": "committed"})
            digest.update(reply.points.tobytes() if isinstance(reply, Fetched) else reply.type.encode())
        return digest.hexdigest()
