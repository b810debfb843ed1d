"""What the chain of journal records says: the session's foundation, its epoch and its latest commits.

=============  =======================================================================================================
kind           body
=============  =======================================================================================================
"build"        session, spec and mesh (sha256 of ``spec.json`` and ``mesh.bin``), nodes, dimension, record_area,
               capacity, epoch
"commit"       step, digest, requests ([client, sequence, content] of each partition), receipt (what the replies say)
"epoch"        epoch
"checkpoint"   as "build", and commits: the bodies of the latest commits; first record of a manifest that replaced a
               full one
=============  =======================================================================================================
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from mesh_motion_server.errors import JournalError
from mesh_motion_server.session.records import Record
from mesh_motion_server.session.replies import RequestId

__all__ = ["Commit", "Foundation", "Ledger"]


@dataclass(frozen=True)
class Foundation:
    """What BUILD fixes.

    Attributes
    ----------
    session : str
    spec, mesh : bytes
        sha256 of the files that hold them.
    nodes, dimension : int
        Shape of one committed state.
    record_area : int
        Bytes at a slot's start for the copy of its record.
    """

    session: str
    spec: bytes
    mesh: bytes
    nodes: int
    dimension: int
    record_area: int

    @property
    def state_bytes(self) -> int:
        """Bytes of one committed state in a slot."""
        return 8 * self.nodes * self.dimension

    def as_body(self) -> dict[str, Any]:
        """Its part of a record's body."""
        return {
            "session": self.session,
            "spec": self.spec,
            "mesh": self.mesh,
            "nodes": self.nodes,
            "dimension": self.dimension,
            "record_area": self.record_area,
        }


@dataclass(frozen=True)
class Commit:
    """One committed step.

    Attributes
    ----------
    step : int
    digest : bytes
        State digest of :mod:`mesh_motion_protocol.digests`; it is also the checksum of the state's slot.
    requests : tuple of RequestId
        The COMMIT of each partition.
    receipt : bytes
        What their replies say, packed by the caller.
    """

    step: int
    digest: bytes
    requests: tuple[RequestId, ...]
    receipt: bytes

    def as_body(self) -> dict[str, Any]:
        """The record's body."""
        return {
            "kind": "commit",
            "step": self.step,
            "digest": self.digest,
            "requests": [[r.client, r.sequence, r.content] for r in self.requests],
            "receipt": self.receipt,
        }

    @classmethod
    def from_body(cls, body: dict[str, Any]) -> Commit:
        """The inverse of :meth:`as_body`."""
        requests = tuple(RequestId(*request) for request in body["requests"])
        return cls(body["step"], body["digest"], requests, body["receipt"])


@dataclass(frozen=True)
class Ledger:
    """The sum of all records so far.

    Attributes
    ----------
    foundation : Foundation
    capacity : int
        Bytes the manifest file was given.
    epoch : int
    commits : tuple of Commit
        The latest ones, oldest first.
    last : Record
        The end of the chain.
    """

    foundation: Foundation
    capacity: int
    epoch: int
    commits: tuple[Commit, ...]
    last: Record

    @property
    def step(self) -> int:
        """The last committed step."""
        return self.commits[-1].step if self.commits else 0

    @classmethod
    def start(cls, record: Record) -> Ledger:
        """From the first record of a manifest.

        Raises
        ------
        JournalError
            If it is of a kind that starts no manifest.
        """
        body = record.body
        if record.kind not in ("build", "checkpoint"):
            raise JournalError(f"a manifest starts with a record of kind 'build' or 'checkpoint', not {record.kind!r}")
        foundation = Foundation(**{name: body[name] for name in Foundation.__dataclass_fields__})
        commits = tuple(Commit.from_body(commit) for commit in body.get("commits", ()))
        return cls(foundation, body["capacity"], body["epoch"], commits, record)

    def after(self, record: Record, keep: int) -> Ledger:
        """With the next record, of the commits the latest ``keep``.

        Raises
        ------
        JournalError
            On an unknown kind, or a step or epoch out of turn.
        """
        if record.kind == "epoch" and record.body["epoch"] > self.epoch:
            return replace(self, epoch=record.body["epoch"], last=record)
        if record.kind == "commit" and record.body["step"] == self.step + 1:
            commits = (*self.commits, Commit.from_body(record.body))[-keep:]
            return replace(self, commits=commits, last=record)
        raise JournalError(
            f"record {record.sequence} of kind {record.kind!r} does not follow step {self.step}, epoch {self.epoch}",
            details={"record": record.sequence},
        )

    def checkpoint_body(self, capacity: int) -> dict[str, Any]:
        """Body of the record that starts the next manifest."""
        return {
            "kind": "checkpoint",
            **self.foundation.as_body(),
            "capacity": capacity,
            "epoch": self.epoch,
            "commits": [commit.as_body() for commit in self.commits],
        }
