"""The catalogue of protocol 1.0: every message as a frozen dataclass, and the reply and the endpoint of each request.

A message is a header (frame 0: a msgpack map of the scalar and map fields) and named arrays (raw frames). Fields whose
annotation is :class:`ArrayField` are arrays; all others go into the header. :data:`MESSAGES` maps the type name on the
wire to the class; the codec, SPEC.md's field tables and the conformance vectors are made from these declarations.

A server has two kinds of endpoint. The *control* endpoint (gateway) takes HELLO, OPEN, RESUME, LIST, PROBE: headers
only. Each session has a worker process with a *data* endpoint of its own, named in OPENED and RESUMED, that takes JOIN,
UPLOAD, BUILD, MOVE, JUDGE, CORRECT, COMMIT, ROLLBACK, FETCH, STATUS, CLOSE. Both take PING.

A solver that runs on n ranks joins a session as n *partitions*. BUILD, MOVE, JUDGE, CORRECT, COMMIT, ROLLBACK are
collective: the server waits for all partitions and then answers each.
"""

from __future__ import annotations

from mesh_motion_protocol.control_messages import (
    Hello,
    List,
    Listed,
    Open,
    Opened,
    Ping,
    Pong,
    Probe,
    Probed,
    Resume,
    Resumed,
    Welcome,
)
from mesh_motion_protocol.data_messages import (
    Build,
    Built,
    Close,
    Closed,
    Commit,
    Committed,
    Correct,
    Corrected,
    Cotangent,
    CotangentFound,
    Fetch,
    Fetched,
    Join,
    Joined,
    Judge,
    Judged,
    Move,
    Moved,
    Rollback,
    RolledBack,
    SessionMessage,
    Status,
    StatusReport,
    Tangent,
    TangentFound,
    Upload,
    Uploaded,
)
from mesh_motion_protocol.declarations import ArrayField
from mesh_motion_protocol.message import ErrorReply, Message

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
    "Correct",
    "Corrected",
    "Cotangent",
    "CotangentFound",
    "ErrorReply",
    "Fetch",
    "Fetched",
    "Hello",
    "Join",
    "Joined",
    "Judge",
    "Judged",
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
    "SessionMessage",
    "Status",
    "StatusReport",
    "Tangent",
    "TangentFound",
    "Upload",
    "Uploaded",
    "Welcome",
]

MESSAGES: dict[str, type[Message]] = {
    m.type: m
    for m in (
        Hello, Welcome, Open, Opened, Resume, Resumed, List, Listed, Probe, Probed, Ping, Pong,
        Join, Joined, Upload, Uploaded, Build, Built, Move, Moved, Tangent, TangentFound, Cotangent,
        CotangentFound, Judge, Judged, Correct, Corrected, Commit, Committed,
        Rollback, RolledBack, Fetch, Fetched, Status, StatusReport, Close, Closed, ErrorReply,
    )
}  # fmt: skip

#: Request type → the type of its reply; every request may also be answered by ERROR.
REPLIES: dict[str, str] = {
    "HELLO": "WELCOME", "OPEN": "OPENED", "RESUME": "RESUMED", "LIST": "LISTED", "PROBE": "PROBED", "PING": "PONG",
    "JOIN": "JOINED", "UPLOAD": "UPLOADED", "BUILD": "BUILT", "MOVE": "MOVED", "TANGENT": "TANGENT_FOUND",
    "COTANGENT": "COTANGENT_FOUND", "JUDGE": "JUDGED",
    "CORRECT": "CORRECTED", "COMMIT": "COMMITTED",
    "ROLLBACK": "ROLLED_BACK", "FETCH": "FETCHED", "STATUS": "STATUS_REPORT", "CLOSE": "CLOSED",
}  # fmt: skip

#: Requests that the control endpoint takes; all others, and PING, go to a session's data endpoint.
CONTROL = frozenset({"HELLO", "OPEN", "RESUME", "LIST", "PROBE", "PING"})

#: Requests that wait for every partition of the session.
COLLECTIVE = frozenset({"BUILD", "MOVE", "TANGENT", "COTANGENT", "JUDGE", "CORRECT", "COMMIT", "ROLLBACK"})
