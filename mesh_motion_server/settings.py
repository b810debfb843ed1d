"""Settings at the edges, checked strictly: how a mesh is moved, and how the server runs.

:class:`MethodSettings` has the keys of the case file's ``[method]`` and of OPEN's ``settings``, :class:`ServerSettings`
those of the server. Unknown keys, wrong types (``"0.5"`` for a number, ``1`` for a truth value), NaN and infinity are
refused with one line that names the key, the value and what was expected.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from mesh_motion_numerics.method import KEYS, Key, Method
from mesh_motion_protocol.errors import InvalidInput, meant
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    create_model,
    field_validator,
    model_validator,
)

_Level = Literal["full", "replay", "relaxed"]
#: Durability levels that a server offers unless its settings name others, the default first.
DURABILITY_LEVELS: tuple[_Level, ...] = ("full", "replay", "relaxed")

#: Required values of the method so that a motion's field, and regions of bad cells, are enough to move the volume.
_WITHOUT_VOLUME: dict[str, tuple[str, ...]] = {
    "displacement": ("absolute",),
    "correction": ("none", "smooth", "optimised"),
    "reduction": ("none",),
}
#: The same by correction: sub-steps need the volume, except those of the smooth correction; the best possible mesh
#: frees all nodes.
_NEVER: dict[str, tuple[str, ...]] = {"sub_steps": ("never",)}
_OF_CORRECTION: dict[str, dict[str, tuple[str, ...]]] = {
    "none": _NEVER,
    "optimised": _NEVER | {"correction_target": ("threshold",)},
}

_Length = Annotated[float, Field(gt=0)]


class _Strict(BaseModel):
    """Base of the settings: no value is converted, no unknown key is ignored, and nothing can be changed later."""

    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False, frozen=True, validate_default=True)

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any]) -> Self:
        """Check plain values, as they come from a case file or the wire.

        Raises InvalidInput: INVALID_ARGUMENT.SETTINGS, naming the first offending key, its value and what was expected.
        """
        try:
            return cls.model_validate(dict(values))
        except ValidationError as error:
            raise _first_offender(error, cls) from error


def _checked(key: Key) -> AfterValidator:
    """The range of a key."""

    def within(value: Any) -> Any:
        if not key.admits(value):
            raise ValueError(key.expected)
        return value

    return AfterValidator(within)


_FIELDS: dict[str, Any] = {
    name: (Annotated[key.kind | None if key.default is None else key.kind, _checked(key)], key.default)
    for name, key in KEYS.items()
}
_KEYS: Any = create_model("_KEYS", __base__=_Strict, **_FIELDS)


class MethodSettings(_KEYS):  # type: ignore[misc]  # its fields are those of a table
    """The case file's ``[method]``: the keys of :data:`mesh_motion_numerics.method.KEYS`."""

    @model_validator(mode="after")
    def _fit_together(self) -> Self:
        self.__dict__.update(self.to_method().as_dict())  # missing keys are chosen once, and stored with their values
        return self

    def to_method(self) -> Method:
        """The numerics' form of the same choices."""
        return Method(**self.model_dump())


class ServerSettings(_Strict):
    """How the server runs: where it listens, where it keeps sessions, and every limit.

    ``metrics`` is HOST:PORT of the pages for Prometheus and probes, ``monitor`` of the page for people. A loop that is
    silent for ``stuck_seconds`` counts as stuck. A new session is refused if it would leave less than
    ``reserve_disk_bytes`` or ``reserve_memory_bytes`` to the running ones. ``history_bytes`` is the largest size of
    each session's history, in addition to its journal; 0: none is kept.

    ``data_ports`` is the range, as ``"7441-7504"``, from which each session's data endpoint takes a free port: what a
    firewall opens and a container maps; without it the system chooses. ``advertised_host`` is sent to clients as the
    host of data endpoints in place of the one listened on; ``"0.0.0.0"`` stands for the host by which a client has
    reached the control endpoint. Both are for tcp.

    ``durability`` lists the levels that OPEN may ask for, the default first; sessions stored at other levels can still
    be resumed. With level "replay" a state is stored every ``snapshot_steps`` commits and every minute: when a session
    is resumed after a crash, at most this number of moves is recomputed.
    """

    endpoint: str = "tcp://127.0.0.1:7440"  # where it listens: tcp://HOST:PORT or ipc:///PATH
    advertised_host: Annotated[str, Field(pattern=r"^[^\s/]+$")] | None = None  # of data endpoints
    data_ports: Annotated[str, Field(pattern=r"^[0-9]+-[0-9]+$")] | None = None  # a range
    state_folder: Annotated[Path, Field(strict=False)] = Path("~/.local/state/mesh-motion")  # where sessions are stored
    keys_folder: Annotated[Path | None, Field(strict=False)] = None  # keys of the server and its clients; None: no keys
    max_sessions: Annotated[int, Field(ge=1)] = 64  # sessions with a worker at a time
    max_sessions_per_key: Annotated[int | None, Field(ge=1)] = None  # of one key of a client; None: no limit
    max_partitions: Annotated[int, Field(ge=1, le=256)] = 256  # partitions of one session
    max_session_bytes: Annotated[int, Field(ge=1 << 10)] = 4 << 30  # mesh of one session
    max_header_bytes: Literal[65536] = 65536  # of the protocol
    max_chunk_bytes: Annotated[int, Field(ge=1 << 10)] = 16 << 20  # one frame of an array
    max_label_characters: Annotated[int, Field(ge=1)] = 200  # of a session's label
    worker_memory_bytes: Annotated[int, Field(ge=256 << 20)] = 8 << 30  # address space of one session
    factor_cache_bytes: Annotated[int, Field(ge=0)] = 1 << 30  # factorizations that a session keeps
    stored_replies: Annotated[int, Field(ge=1)] = 8  # kept for repeated requests, per client
    stored_reply_bytes: Annotated[int, Field(ge=1 << 10)] = 32 << 20  # arrays of all kept replies of a session
    durability: Annotated[list[_Level], Field(min_length=1)] = list(DURABILITY_LEVELS)  # first: default
    snapshot_steps: Annotated[int, Field(ge=1, le=100_000)] = 50  # at level "replay" a state is stored so often
    threads: Annotated[int, Field(ge=0, le=1024)] = 0  # of each worker; 0: as many as there are cores
    collective_timeout_seconds: _Length = 120.0  # a collective request waits for the other partitions
    lease_seconds: _Length = 60.0  # without a connection a session is then suspended
    handshake_seconds: _Length = 5.0  # a connection that keeps silent is then closed
    idle_seconds: _Length = 3600.0  # and a suspended session's worker then ends
    drain_seconds: _Length = 30.0  # a stopping server lets running requests finish
    metrics: Annotated[str, Field(pattern=r"^.+:[0-9]{1,5}$")] | None = None  # Prometheus, probes
    monitor: Annotated[str | None, Field(pattern=r"^.+:[0-9]{1,5}$")] = None  # HOST:PORT of the page
    stuck_seconds: _Length = 30.0  # a loop that is silent for so long is unhealthy
    reserve_disk_bytes: Annotated[int, Field(ge=0)] = 256 << 20  # no new session where less of the disk would be left
    reserve_memory_bytes: Annotated[int, Field(ge=0)] = 256 << 20  # no new session where less memory would be left
    history_bytes: Annotated[int, Field(ge=0)] = 2 << 30  # a session's history for people; 0: none

    @field_validator("durability")
    @classmethod
    def _each_once(cls, value: list[str]) -> list[str]:
        if len(set(value)) < len(value):
            raise ValueError("each level once")
        return value

    @field_validator("data_ports")
    @classmethod
    def _a_range(cls, value: str | None) -> str | None:
        first, last = map(int, (value or "1-1").split("-"))
        if not 1 <= first <= last <= 65535:
            raise ValueError("FIRST-LAST of 1 to 65535")
        return value

    @field_validator("state_folder", "keys_folder")
    @classmethod
    def _in_utf_8(cls, value: Path | None) -> Path | None:
        if value is not None and any("\ud800" <= letter <= "\udfff" for letter in os.path.expanduser(value)):
            raise ValueError("a path in UTF-8")  # workers get the settings as JSON
        return value

    def limits(self) -> dict[str, int]:
        """The limits that WELCOME announces: names and units as in SPEC.md."""
        names = (
            "max_sessions",
            "max_partitions",
            "max_session_bytes",
            "max_header_bytes",
            "max_chunk_bytes",
            "max_label_characters",
            "stored_replies",
            "stored_reply_bytes",
        )
        limits = {name: int(getattr(self, name)) for name in names}
        return limits | {
            "collective_timeout_ms": round(1000 * self.collective_timeout_seconds),
            "lease_ms": round(1000 * self.lease_seconds),
            "idle_ms": round(1000 * self.idle_seconds),
            "drain_ms": round(1000 * self.drain_seconds),
        }


def check_durability(level: str, offered: Sequence[str] = DURABILITY_LEVELS) -> str:
    """The level in force: ``""`` asks for the default. Raises InvalidInput if the level is not offered."""
    if level and level not in offered:
        raise InvalidInput(
            f"durability: {level!r} is not offered; offered are {', '.join(offered)}",
            code="INVALID_ARGUMENT.VALUE",
            hint="leave it empty for the default",
            details={"field": "durability", "value": level},
        )
    return level or offered[0]


def check_evaluation(evaluation: str, settings: MethodSettings, time_levels: str = "") -> None:
    """Check that the client can evaluate the motion, if it requests this.

    Raises InvalidInput: INVALID_ARGUMENT.SETTINGS, naming the first setting that needs the volume;
    INVALID_ARGUMENT.VALUE if time levels of its nodes are to be stored.
    """
    if evaluation != "client":
        return
    if time_levels:
        raise InvalidInput(
            f"evaluation = 'client': expected time_levels '', got {time_levels!r}: the server does not have the nodes",
            code="INVALID_ARGUMENT.VALUE",
            hint="compute velocities in the client from the nodes' positions, or open with evaluation = 'server'",
            details={"field": "time_levels", "value": time_levels},
        )
    for key, admitted in (_WITHOUT_VOLUME | _OF_CORRECTION.get(settings.correction, {})).items():
        got = getattr(settings, key)
        if got not in admitted:
            expected = " or ".join(map(repr, admitted))
            raise InvalidInput(
                f"evaluation = 'client': expected {key} = {expected}, got {got!r}",
                code="INVALID_ARGUMENT.SETTINGS",
                hint=f"set {key} = {expected}, or open the session with evaluation = 'server'",
                details={"setting": key, "value": got, "expected": list(admitted)},
            )


def _first_offender(error: ValidationError, model: type[BaseModel]) -> InvalidInput:
    """One line for the first error: key, value, what was expected."""
    first = error.errors(include_url=False)[0]
    key = ".".join(str(part) for part in first["loc"] if str(part) in model.model_fields) or str(first["loc"][0])
    if first["type"] == "extra_forbidden":
        known = ", ".join(model.model_fields)
        similar = meant(key, model.model_fields)
        return _refused(f"unknown setting {key!r}; known are {known}", {"setting": key}, similar)
    value, expected = first["input"], _expectation(first["msg"])
    choices = expected.removeprefix("one of ").split(", ") if expected.startswith("one of ") else []
    message = f"setting {key!r}: expected {expected}, got {value!r}"
    return _refused(message, {"setting": key, "value": repr(value)}, meant(str(value), choices))


def _refused(message: str, details: dict[str, object], hint: str = "") -> InvalidInput:
    return InvalidInput(message, code="INVALID_ARGUMENT.SETTINGS", details=details, hint=hint)


def _expectation(message: str) -> str:
    """The part of pydantic's message that says what was expected."""
    for prefix in ("Value error, ", "Input should be ", "Input "):
        if message.startswith(prefix):
            return message.removeprefix(prefix)
    return message
