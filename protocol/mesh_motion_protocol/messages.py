"""The messages of protocol 1.0 as frozen dataclasses: requests, their replies, and the error reply.

A message is a header (frame 0: a msgpack map of the scalar and map fields) and named arrays (raw frames). Fields whose
annotation is :class:`ArrayField` are arrays; all others go into the header. :data:`MESSAGES` maps the type name on the
wire to the class; the codec, SPEC.md's field tables and the conformance vectors are made from these declarations.

Two endpoints are spoken to. The *control* endpoint (gateway) takes HELLO, OPEN, RESUME, LIST, PROBE: headers only. Each
session has a worker process with a *data* endpoint of its own, named in OPENED and RESUMED, that takes JOIN, UPLOAD,
BUILD, MOVE, COMMIT, ROLLBACK, FETCH, STATUS, CLOSE. PING is taken by both.

A solver that runs on n ranks joins a session as n *partitions*. BUILD, MOVE, COMMIT, ROLLBACK are collective: the
server waits for all partitions and then answers each.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from mesh_motion_protocol.declarations import ArrayField, Choice, Length, Range

__all__ = [
    "COLLECTIVE",
    "CONTROL",
    "MESSAGES",
    "REPLIES",
    "ArrayField",
    "Build",
    "Built",
    "Close",
    "Closed",
    "Commit",
    "Committed",
    "ErrorReply",
    "Fetch",
    "Fetched",
    "Hello",
    "Join",
    "Joined",
    "List",
    "Listed",
    "Message",
    "Move",
    "Moved",
    "Open",
    "Opened",
    "Ping",
    "Pong",
    "Probe",
    "Probed",
    "Resume",
    "Resumed",
    "Rollback",
    "RolledBack",
    "Status",
    "StatusReport",
    "Upload",
    "Uploaded",
    "Welcome",
]


Uuid = Annotated[bytes, Length(exactly=16)]
Token = Annotated[bytes, Length(exactly=32)]
Digest = Annotated[bytes, Length(exactly=32)]
SessionId = Annotated[str, Length(at_most=32)]
Name = Annotated[str, Length(at_most=256)]
Count = Annotated[int, Range(0, 2**63 - 1)]
Partition = Annotated[int, Range(0, 255)]
Frame = Annotated[str, Choice(("committed", "reference"))]
Outcome = Annotated[str, Choice(("keep", "discard"))]
Role = Annotated[str, Choice(("", "moving", "fixed", "slip", "symmetry", "periodic"))]

FloatNodes = Annotated[NDArray[np.float64], ArrayField("<f8", ("node", "dimension"))]
FloatMoving = Annotated[NDArray[np.float64], ArrayField("<f8", ("moving node", "dimension"))]
FloatEnrichment = Annotated[NDArray[np.float64], ArrayField("<f8", ("enrichment point", "dimension"))]
MovingIndices = Annotated[NDArray[np.int64], ArrayField("<i8", ("moving node",))]
KnownMovingIndices = Annotated[NDArray[np.int64] | None, ArrayField("<i8", ("moving node",), required=False)]
UploadRows = Annotated[NDArray[Any] | None, ArrayField("<f8|<i8", ("row", "column"), required=False)]


@dataclass(frozen=True, kw_only=True, eq=False)
class Message:
    """Base of all messages.

    Attributes
    ----------
    client : bytes
        16-byte UUID of the client, made once per client object. On a reply: that of the request.
    sequence : int
        1, 2, 3, … per client. (client, sequence) is the *request id*: a repeat with the same content gets the stored
        reply, a repeat with other content ABORTED.CONFLICT. On a reply: that of the request.
    """

    type: ClassVar[str] = ""
    client: Uuid = b"\0" * 16
    sequence: Count = 0


# --- control endpoint ------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True, eq=False)
class Hello(Message):
    """First message on a control connection: what the client speaks."""

    type: ClassVar[str] = "HELLO"
    versions: list[list[int]] = field(default_factory=lambda: [[1, 0]])  # [major, minor], preferred first
    features: list[str] = field(default_factory=list)  # features the client can use
    agent: Name = ""  # name and version of the client, for logs


@dataclass(frozen=True, kw_only=True, eq=False)
class Welcome(Message):
    """Answer to HELLO: the choice, every limit, and who answers."""

    type: ClassVar[str] = "WELCOME"
    version: list[int]  # the chosen [major, minor]
    features: list[str]  # features both sides have
    server: str  # name and version
    boot: Uuid  # 16 bytes, new at each start of the server
    limits: dict[str, int]  # by name: section 6
    durability: list[str]  # levels this server offers, the default first


@dataclass(frozen=True, kw_only=True, eq=False)
class Open(Message):
    """Asks for a new session."""

    type: ClassVar[str] = "OPEN"
    dimension: Annotated[int, Range(1, 3)]  # 1, 2 or 3: number of coordinates
    partitions: Annotated[int, Range(1, 256)] = 1  # how many partitions will join
    settings: dict[str, Any] = field(default_factory=dict)  # keys of the case file's [method]; absent = default
    label: Name = ""  # shown in logs and lists
    bytes_reserved: Count = 0  # what the upload will take, all partitions; 0 = unknown
    durability: Annotated[str, Choice(("", "full", "replay", "relaxed"))] = ""  # "" = the server's default


@dataclass(frozen=True, kw_only=True, eq=False)
class Opened(Message):
    """A session exists; its worker listens on ``endpoint``."""

    type: ClassVar[str] = "OPENED"
    session: str  # id, 32 hex digits
    token: Token  # whoever has it may resume the session: keep it secret
    endpoint: str  # the data endpoint
    epoch: int  # 1; raised by each RESUME, which fences earlier holders


@dataclass(frozen=True, kw_only=True, eq=False)
class Resume(Message):
    """Asks for an existing session: after a crash of the client, of the worker, or a restart of the server."""

    type: ClassVar[str] = "RESUME"
    session: SessionId  # as in OPENED
    token: Token  # as in OPENED


@dataclass(frozen=True, kw_only=True, eq=False)
class Resumed(Message):
    """The session is there again, at its last committed step."""

    type: ClassVar[str] = "RESUMED"
    session: str  # as asked
    endpoint: str  # the data endpoint
    epoch: int  # the one to use from now on
    state: str  # a state of the session table
    step: int  # last committed step


@dataclass(frozen=True, kw_only=True, eq=False)
class List(Message):
    """Asks for the sessions this server holds (only those the asker may see)."""

    type: ClassVar[str] = "LIST"
    after: SessionId = ""  # sessions come in the order of their ids; only those behind this one


@dataclass(frozen=True, kw_only=True, eq=False)
class Listed(Message):
    """The sessions: maps with session, label, state, step, partitions, worker ("alive" | "none"), no secrets."""

    type: ClassVar[str] = "LISTED"
    sessions: list[dict[str, Any]]  # section 15
    more: bool = False  # ask again with after = the last id


@dataclass(frozen=True, kw_only=True, eq=False)
class Probe(Message):
    """Asks the gateway about one session's worker while the worker itself may be busy computing."""

    type: ClassVar[str] = "PROBE"
    session: SessionId  # as in OPENED
    token: Token  # as in OPENED


@dataclass(frozen=True, kw_only=True, eq=False)
class Probed(Message):
    """Answer to PROBE."""

    type: ClassVar[str] = "PROBED"
    session: str  # as asked
    worker: str  # "starting" | "alive" | "dead" | "none"
    epoch: int  # of the session; 0 where the worker is "none"
    endpoint: str = ""  # the data endpoint while the worker is alive; what a joining partition needs


@dataclass(frozen=True, kw_only=True, eq=False)
class Ping(Message):
    """Asks whether anybody is there; taken by both endpoints."""

    type: ClassVar[str] = "PING"


@dataclass(frozen=True, kw_only=True, eq=False)
class Pong(Message):
    """Answer to PING."""

    type: ClassVar[str] = "PONG"


# --- data endpoint ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True, eq=False)
class SessionMessage(Message):
    """Base of the requests to a session's data endpoint."""

    session: SessionId  # as in OPENED
    epoch: Count  # of OPENED or RESUMED
    partition: Partition = 0  # 0 … partitions - 1


@dataclass(frozen=True, kw_only=True, eq=False)
class Join(SessionMessage):
    """First message on a data connection; proves the right to the session."""

    type: ClassVar[str] = "JOIN"
    token: Token  # as in OPENED


@dataclass(frozen=True, kw_only=True, eq=False)
class Joined(Message):
    """Answer to JOIN: where the session stands."""

    type: ClassVar[str] = "JOINED"
    state: str  # a state of the session table
    step: int  # last committed step
    iteration: int  # iterations of the open trial, 0 = none
    dimension: int = 0  # as in OPEN; 0 = the server does not say
    partitions: int = 0  # as in OPEN; 0 = the server does not say
    nodes: int = 0  # nodes of this partition once BUILT
    moving_nodes: KnownMovingIndices = None  # as in BUILT, once BUILT


@dataclass(frozen=True, kw_only=True, eq=False)
class Upload(SessionMessage):
    """One part of a partition's mesh. Parts of one ``item`` and ``name`` are appended in the order they come.

    item        name              rows
    nodes       —                 (k, dimension) <f8 coordinates
    global_ids  —                 (k, 1) <i8; only with partitions > 1, where they are required
    cells       the cell type     (k, nodes of the type) <i8 local node indices, 0-based
    patch       the patch's name  (k, 1) <i8 local node indices; ``role`` is required
    """

    type: ClassVar[str] = "UPLOAD"
    item: Annotated[str, Choice(("nodes", "global_ids", "cells", "patch"))]  # what the rows are
    name: Name = ""  # of the cell type or the patch
    role: Role = ""  # with item = "patch"
    rows: UploadRows = None  # required; shape and dtype depend on the item: section 13


@dataclass(frozen=True, kw_only=True, eq=False)
class Uploaded(Message):
    """Answer to UPLOAD: how many rows of this item and name the partition has now."""

    type: ClassVar[str] = "UPLOADED"
    rows_total: int  # rows of this item and name so far


@dataclass(frozen=True, kw_only=True, eq=False)
class Build(SessionMessage):
    """Collective: the mesh is complete; check it, make it durable, become READY."""

    type: ClassVar[str] = "BUILD"


@dataclass(frozen=True, kw_only=True, eq=False)
class Built(Message):
    """The session is READY at step 0. ``moving_nodes``: this partition's local indices of the nodes whose displacement
    every MOVE must give, ascending; the rows of MOVE.displacement are in this order.
    """

    type: ClassVar[str] = "BUILT"
    step: int  # 0
    settings: dict[str, Any]  # the settings in force, defaults filled in
    mesh: dict[str, Any]  # counts, bounding box, warnings: section 15
    quality: dict[str, Any]  # summary of the mesh as uploaded: section 15
    moving_nodes: MovingIndices  # local indices, ascending: the order of the rows of MOVE


@dataclass(frozen=True, kw_only=True, eq=False)
class Move(SessionMessage):
    """Collective: one coupling iteration of the step ``step``. Any earlier trial of the step is replaced."""

    type: ClassVar[str] = "MOVE"
    step: Count  # committed step + 1
    frame: Frame = "committed"  # displacement since the "committed" state, or since the "reference" mesh (total)
    displacement: FloatMoving  # of the moving nodes (BUILT.moving_nodes), mesh length unit


@dataclass(frozen=True, kw_only=True, eq=False)
class Moved(Message):
    """The trial: displacements of all of the partition's nodes, in the frame of the MOVE."""

    type: ClassVar[str] = "MOVED"
    step: int  # as asked
    iteration: int  # 1, 2, … within the step
    quality: dict[str, Any]  # predicted, "standard" and "corrected": section 15
    correction: dict[str, Any]  # what was done: method, enrichment points, freed nodes, iterations, reached
    caches: dict[str, Any]  # {"factorization": "reused" | "made", …}
    seconds: dict[str, float]  # solve, predict, correct, displace, total
    warnings: list[str]  # for people
    displacement: FloatNodes  # of all nodes of the partition, since the frame of the MOVE
    enrichment_points: FloatEnrichment  # where enrichment functions were added


@dataclass(frozen=True, kw_only=True, eq=False)
class Commit(SessionMessage):
    """Collective: the trial of ``step`` becomes the committed state, durably before the answer."""

    type: ClassVar[str] = "COMMIT"
    step: Count  # committed step + 1


@dataclass(frozen=True, kw_only=True, eq=False)
class Committed(Message):
    """The step is committed."""

    type: ClassVar[str] = "COMMITTED"
    step: int  # as asked
    durable_step: int  # with durability "full" equal to ``step``
    digest: Digest  # of the committed state: section 16
    quality: dict[str, Any]  # summary of the committed mesh, from its coordinates: section 15


@dataclass(frozen=True, kw_only=True, eq=False)
class Rollback(SessionMessage):
    """Collective: the trial of ``step``, if any, is dropped."""

    type: ClassVar[str] = "ROLLBACK"
    step: Count  # committed step + 1


@dataclass(frozen=True, kw_only=True, eq=False)
class RolledBack(Message):
    """The session is READY at its last committed step."""

    type: ClassVar[str] = "ROLLED_BACK"
    step: int  # last committed step


@dataclass(frozen=True, kw_only=True, eq=False)
class Fetch(SessionMessage):
    """Asks for the partition's node coordinates. ``what``: "committed" | "reference"."""

    type: ClassVar[str] = "FETCH"
    what: Frame = "committed"  # which coordinates


@dataclass(frozen=True, kw_only=True, eq=False)
class Fetched(Message):
    """Answer to FETCH."""

    type: ClassVar[str] = "FETCHED"
    step: int  # last committed step
    points: FloatNodes  # coordinates of all nodes of the partition


@dataclass(frozen=True, kw_only=True, eq=False)
class Status(SessionMessage):
    """Asks where the session stands."""

    type: ClassVar[str] = "STATUS"


@dataclass(frozen=True, kw_only=True, eq=False)
class StatusReport(Message):
    """Answer to STATUS. ``waiting_for``: partitions a collective request is still waiting for."""

    type: ClassVar[str] = "STATUS_REPORT"
    state: str  # a state of the session table
    step: int  # last committed step
    iteration: int  # moves of the open trial, 0 = none
    waiting_for: list[int]  # partitions that a collective request is still waiting for
    report: dict[str, Any]  # counters, memory, quality of the last commit


@dataclass(frozen=True, kw_only=True, eq=False)
class Close(SessionMessage):
    """Ends this holder's use. ``outcome``: "keep" leaves the session durable and resumable, "discard" deletes it."""

    type: ClassVar[str] = "CLOSE"
    outcome: Outcome = "keep"  # one partition's "discard" discards, once all have closed


@dataclass(frozen=True, kw_only=True, eq=False)
class Closed(Message):
    """The session's worker is about to end."""

    type: ClassVar[str] = "CLOSED"
    step: int  # last committed step


# --- errors ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True, eq=False)
class ErrorReply(Message):
    """Answer to any request that failed. Nothing of the request took effect."""

    type: ClassVar[str] = "ERROR"
    code: str  # a code of SPEC.md, e.g. "INVALID_ARGUMENT.NONFINITE"
    message: str  # what was expected, what came
    hint: str  # the way out
    retryable: bool  # the same request may succeed later
    state: str  # the session's state afterwards, "" when there is none
    details: dict[str, Any]  # names the first offender: section 15


MESSAGES: dict[str, type[Message]] = {
    m.type: m
    for m in (
        Hello, Welcome, Open, Opened, Resume, Resumed, List, Listed, Probe, Probed, Ping, Pong,
        Join, Joined, Upload, Uploaded, Build, Built, Move, Moved, Commit, Committed, Rollback, RolledBack,
        Fetch, Fetched, Status, StatusReport, Close, Closed, ErrorReply,
    )
}  # fmt: skip

#: Request type → the type of its reply; every request may also be answered by ERROR.
REPLIES: dict[str, str] = {
    "HELLO": "WELCOME", "OPEN": "OPENED", "RESUME": "RESUMED", "LIST": "LISTED", "PROBE": "PROBED", "PING": "PONG",
    "JOIN": "JOINED", "UPLOAD": "UPLOADED", "BUILD": "BUILT", "MOVE": "MOVED", "COMMIT": "COMMITTED",
    "ROLLBACK": "ROLLED_BACK", "FETCH": "FETCHED", "STATUS": "STATUS_REPORT", "CLOSE": "CLOSED",
}  # fmt: skip

#: Requests the control endpoint takes; all others, and PING, go to a session's data endpoint.
CONTROL = frozenset({"HELLO", "OPEN", "RESUME", "LIST", "PROBE", "PING"})

#: Requests that wait for every partition of the session.
COLLECTIVE = frozenset({"BUILD", "MOVE", "COMMIT", "ROLLBACK"})
