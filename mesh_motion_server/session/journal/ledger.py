"""The content of the chain of journal records: the session's foundation, epoch, latest commits and last snapshot.

=============  =======================================================================================================
kind           body
=============  =======================================================================================================
"build"        session, spec and mesh (sha256 of ``spec.json`` and ``mesh.bin``), nodes, dimension, record_area,
               capacity, epoch; in format 2 also durability, snapshot_steps, log_bytes
"commit"       step, digest, requests ([client, sequence, content] of each partition), receipt (what the replies say);
               in format 2 also either slot (where its state is), since (the step before its batch) and earlier (the
               bodies of the commits between), or frame, rows and maker (what its state is computed from)
"snapshot"     step, digest, slot: the state of the last commit was stored; format 2 only
"epoch"        epoch
"checkpoint"   as "build", and commits: the bodies of the latest commits; in format 2 also snapshot ([step, digest,
               slot], or nil); first record of a manifest that replaced a full one
=============  =======================================================================================================

In format 1 every commit is a batch of its own, and the slot of its state is its step modulo 2.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from mesh_motion_protocol.errors import DataLoss

from mesh_motion_server.session.journal.records import Record
from mesh_motion_server.session.journal.replies import RequestId


@dataclass(frozen=True)
class Foundation:
    """The values that BUILD fixes."""

    session: str
    #: spec, mesh: sha256 of the files that hold them
    spec: bytes
    mesh: bytes
    #: nodes, dimension: shape of one committed state; where the client evaluates the field, its coefficients count as
    #: nodes
    nodes: int
    dimension: int
    record_area: int  # bytes at a slot's start for the copy of its record
    durability: str = "full"  # a level of :data:`mesh_motion_server.settings.DURABILITY_LEVELS`
    #: snapshot_steps, log_bytes: with "replay": after this many commits, or bytes of them, a commit stores its state
    snapshot_steps: int = 0
    log_bytes: int = 0

    @property
    def state_bytes(self) -> int:
        """Bytes of one committed state in a slot."""
        return 8 * self.nodes * self.dimension

    @property
    def format(self) -> int:
        """The lowest format that has all fields of this level."""
        return 1 if self.durability == "full" else 2

    def as_body(self) -> dict[str, Any]:
        """The foundation's part of a record's body."""
        names = list(self.__dataclass_fields__)
        return {name: getattr(self, name) for name in (names if self.format > 1 else names[:6])}


@dataclass(frozen=True)
class BoundaryInput:
    """The input that determines a committed state, together with the state before and the session's settings."""

    frame: str  # "committed" or "reference"
    rows: bytes  # displacements (k, d) of the moving nodes in that frame, little-endian doubles, ascending by global id
    maker: str  # the versions and the processor that computed the state, for people


@dataclass(frozen=True)
class Commit:
    """One committed step."""

    step: int
    digest: bytes  # state digest of :mod:`mesh_motion_protocol.digests`; it is also the checksum of the state's slot
    requests: tuple[RequestId, ...]  # the COMMIT of each partition
    receipt: bytes  # the content of their replies, packed by the caller
    boundary: BoundaryInput | None = None  # the input, if the state is not stored but recomputed

    def as_body(self) -> dict[str, Any]:
        """The record's body."""
        return {
            "kind": "commit",
            "step": self.step,
            "digest": self.digest,
            "requests": [[r.client, r.sequence, r.content] for r in self.requests],
            "receipt": self.receipt,
        } | (vars(self.boundary) if self.boundary is not None else {})

    @classmethod
    def from_body(cls, body: dict[str, Any]) -> Commit:
        """The inverse of :meth:`as_body`."""
        requests = tuple(RequestId(*request) for request in body["requests"])
        boundary = BoundaryInput(body["frame"], body["rows"], body["maker"]) if "rows" in body else None
        return cls(body["step"], body["digest"], requests, body["receipt"], boundary)


@dataclass(frozen=True)
class Snapshot:
    """A committed state in a slot: its step, its digest, the slot's number."""

    step: int
    digest: bytes
    slot: int


def slot_of(record: Record) -> int | None:
    """The slot with a record's state and copy; None for a record without its own state."""
    if record.kind == "commit" and record.format == 1:
        return int(record.body["step"] % 2)
    slot: int | None = record.body.get("slot") if record.kind in ("commit", "snapshot") else None
    return slot


@dataclass(frozen=True)
class Ledger:
    """The sum of all records so far."""

    foundation: Foundation
    capacity: int  # bytes for records in the manifest file
    epoch: int
    commits: tuple[Commit, ...]  # the latest commits, and all commits after the snapshot, oldest first
    snapshot: Snapshot | None  # the last stored state; None: the mesh as built
    last: Record  # the end of the chain

    @property
    def step(self) -> int:
        """The last committed step."""
        return self.commits[-1].step if self.commits else 0

    @property
    def logged(self) -> tuple[Commit, ...]:
        """The commits after the snapshot, whose states must be recomputed."""
        stored = self.snapshot.step if self.snapshot else 0
        return tuple(commit for commit in self.commits if commit.step > stored)

    @property
    def next_slot(self) -> int:
        """The slot that does not hold the last stored state."""
        return 1 - self.snapshot.slot if self.snapshot else 1

    @classmethod
    def start(cls, record: Record) -> Ledger:
        """Start a ledger from the first record of a manifest.

        Raises DataLoss if it is of a kind that starts no manifest.
        """
        body = record.body
        if record.kind not in ("build", "checkpoint"):
            raise DataLoss(f"a manifest starts with a record of kind 'build' or 'checkpoint', not {record.kind!r}")
        foundation = Foundation(**{name: body[name] for name in Foundation.__dataclass_fields__ if name in body})
        commits = tuple(Commit.from_body(commit) for commit in body.get("commits", ()))
        if record.format == 1:
            last = commits[-1] if commits else None
            snapshot = Snapshot(last.step, last.digest, last.step % 2) if last else None
        else:
            snapshot = Snapshot(*body["snapshot"]) if body.get("snapshot") else None
        return cls(foundation, body["capacity"], body["epoch"], commits, snapshot, record)

    def after(self, record: Record, keep: int) -> Ledger:
        """The ledger after the next record; it keeps the latest ``keep`` commits and those after the snapshot.

        Raises DataLoss on an unknown kind, or a step or epoch out of turn.
        """
        body = record.body
        if record.kind == "epoch" and body["epoch"] > self.epoch:
            return replace(self, epoch=body["epoch"], last=record)
        slot = slot_of(record)
        stored = Snapshot(body["step"], body["digest"], slot) if slot is not None else self.snapshot
        if record.kind == "commit" and body.get("since", body["step"] - 1) == self.step:
            batch = (*map(Commit.from_body, body.get("earlier", ())), Commit.from_body(body))
            commits = _kept((*self.commits, *batch), stored, keep)
            return replace(self, commits=commits, snapshot=stored, last=record)
        if record.kind == "snapshot" and self.commits and body["digest"] == self.commits[-1].digest:
            return replace(self, commits=_kept(self.commits, stored, keep), snapshot=stored, last=record)
        raise DataLoss(
            f"record {record.sequence} of kind {record.kind!r} does not follow step {self.step}, epoch {self.epoch}",
            details={"record": record.sequence},
        )

    def checkpoint_body(self, capacity: int) -> dict[str, Any]:
        """Body of the record that starts the next manifest."""
        snapshot = self.snapshot
        stored = [snapshot.step, snapshot.digest, snapshot.slot] if snapshot else None
        return {
            "kind": "checkpoint",
            **self.foundation.as_body(),
            "capacity": capacity,
            "epoch": self.epoch,
            "commits": [commit.as_body() for commit in self.commits],
        } | ({"snapshot": stored} if self.foundation.format > 1 else {})


def _kept(commits: tuple[Commit, ...], stored: Snapshot | None, keep: int) -> tuple[Commit, ...]:
    """The latest ``keep`` commits and all after the stored state; those up to this state no longer need their input."""
    last = stored.step if stored else 0
    settled = sum(commit.step <= last for commit in commits)
    first = min(settled, max(0, len(commits) - keep))
    return (*(replace(commit, boundary=None) for commit in commits[first:settled]), *commits[settled:])
