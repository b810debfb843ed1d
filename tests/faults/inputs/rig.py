"""A session of a server in this process; requests are frames, so that the decoder checks them too."""

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
from mesh_motion_protocol.codec import decode
from mesh_motion_protocol.messages import ErrorReply, Fetched, Message, Opened

from mesh_motion_server.settings import ServerSettings
from tests.faults.in_process import InProcessServer
from tests.faults.inputs.drafts import Draft, Part, Rows

#: Small, so that a case can pass them.
LIMITS = ServerSettings(
    max_partitions=4, max_session_bytes=1 << 16, max_label_characters=40, durability=["full", "replay"]
)


def frames(kind: str, sequence: int, fields: dict[str, Any], arrays: dict[str, Rows]) -> list[Any]:
    """A message with any content; :func:`mesh_motion_protocol.codec.encode` would refuse most of them."""
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
    """Collect warnings of libraries, for example of overflow in numpy: a checked input causes none."""
    with warnings.catch_warnings(record=True) as caught, np.errstate(all="warn", under="ignore"):
        warnings.simplefilter("always")
        yield
    noise.extend(f"{w.category.__name__}: {w.message}" for w in caught)


def opened(draft: Draft, server: InProcessServer, number: int) -> Rig | ErrorReply:
    """Send OPEN, and JOIN of every partition; the number differs each time."""
    ((_, back),) = server.control("owner", b"control", frames("OPEN", number, draft.opening, {}))
    reply = decode(back)
    if isinstance(reply, ErrorReply):
        return reply
    assert isinstance(reply, Opened)
    rig = Rig(server, reply, draft.opening.get("partitions", 1))
    for partition in range(rig.partitions):
        rig.ask("JOIN", partition, {"token": reply.token})
    return rig


@dataclass
class Rig:
    """A session and its messages; every partition has its own connection."""

    server: InProcessServer
    opened: Opened
    partitions: int
    sequence: int = 0
    noise: list[str] = field(default_factory=list)

    def ask(self, kind: str, partition: int = 0, fields: dict[str, Any] | None = None, **arrays: Rows) -> list[Message]:
        self.sequence += 1
        session = self.opened.session
        known = {"session": session, "epoch": self.opened.epoch, "partition": partition}
        request = frames(kind, self.sequence, known | (fields or {}), arrays)
        with quietly(self.noise):
            replies = self.server.data(session, "owner", b"partition %d" % partition, request)
        return [decode(back) for _, back in replies]

    def upload(self, part: Part, partition: int = 0) -> Message:
        about = {"item": part.item, "name": part.name, "role": part.role}
        (reply,) = self.ask("UPLOAD", partition, about, rows=part.rows)
        return reply

    def upload_all(self, draft: Draft) -> ErrorReply | None:
        """Upload the whole mesh, or up to the first refused part."""
        replies = (self.upload(part, p) for p, parts in enumerate(draft.parts) for part in parts)
        return next((reply for reply in replies if isinstance(reply, ErrorReply)), None)

    def collective(self, kind: str, **fields: Any) -> list[Message]:
        """Send a request of every partition; return the replies."""
        return [reply for p in range(self.partitions) for reply in self.ask(kind, p, fields)]

    def move(self, draft: Draft, step: int | None = None) -> list[Message]:
        """Send the draft's MOVE of every partition; return the replies, without those of an overtaken request."""
        replies: list[Message] = []
        for partition, rows in enumerate(draft.displacement):
            fields = {"step": draft.step if step is None else step, "frame": draft.frame} | draft.extra
            replies += self.ask("MOVE", partition, fields, displacement=rows)
        return [r for r in replies if not (isinstance(r, ErrorReply) and r.code == "ABORTED.STALE")]

    def standing(self) -> str:
        """Digest of the committed coordinates that a partition fetches, exact to the last bit."""
        digest = hashlib.sha256()
        for partition in range(self.partitions):
            (reply,) = self.ask("FETCH", partition, {"what": "committed"})
            digest.update(reply.points.tobytes() if isinstance(reply, Fetched) else reply.type.encode())
        return digest.hexdigest()

    def end(self) -> None:
        if self.server.host(self.opened.session) is not None:
            self.server.kill(self.opened.session)
