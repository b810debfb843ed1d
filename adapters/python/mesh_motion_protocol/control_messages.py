"""Messages of the control endpoint; PING and PONG are those of both."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar

from mesh_motion_protocol.declarations import Choice, Range
from mesh_motion_protocol.field_types import Count, Evaluation, Name, SessionId, TimeLevels, Token, Uuid
from mesh_motion_protocol.message import Message

__all__ = [
    "Hello",
    "List",
    "Listed",
    "Open",
    "Opened",
    "Ping",
    "Pong",
    "Probe",
    "Probed",
    "Resume",
    "Resumed",
    "Welcome",
]


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
    evaluation: Evaluation = "server"  # who moves and judges the nodes of the volume: section 23
    time: float = 0.0  # of the reference mesh, seconds: section 25
    time_levels: TimeLevels = ""  # the scheme whose earlier levels commits store: section 25


@dataclass(frozen=True, kw_only=True, eq=False)
class Opened(Message):
    """A session exists; its worker listens on ``endpoint``."""

    type: ClassVar[str] = "OPENED"
    session: str  # id, 32 hex digits
    token: Token  # a client that has it may resume the session: keep it secret
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
    after: SessionId = ""  # sessions come in the order of their ids; only those after this one


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
