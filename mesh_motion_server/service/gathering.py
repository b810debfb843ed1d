"""A collective request while it waits for the other partitions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from mesh_motion_protocol.errors import InvalidInput, SessionError
from mesh_motion_protocol.messages import Cotangent, Move, SessionMessage, Tangent

from mesh_motion_server.session.journal.replies import RequestId

_COMMON = ("step", "frame", "time", "questions", "what")


@dataclass(frozen=True, eq=False)
class Arrival:
    """One partition's request: its sender, its content, its id, and the result of the command's check."""

    peer: bytes
    request: SessionMessage
    request_id: RequestId
    checked: Any = None


def agreement(request: SessionMessage) -> tuple[tuple[str, object], ...]:
    """The values that the requests of all partitions must have in common: the type, and further fields."""
    common = [name for name in _COMMON if hasattr(request, name)] + (["velocity"] if isinstance(request, Move) else [])
    values = {"type": request.type} | {name: getattr(request, name) for name in common}
    if isinstance(request, Tangent | Cotangent):
        values["columns"] = (request.velocity if isinstance(request, Tangent) else request.weights).shape[1]
    return tuple(values.items())


@dataclass
class Gathering:
    """The requests of one collective that have arrived so far."""

    partitions: int
    deadline: float  # on the host's clock
    arrivals: dict[int, Arrival] = field(default_factory=dict)  # the requests by partition

    @property
    def missing(self) -> list[int]:
        """Partitions whose request has not arrived."""
        return [p for p in range(self.partitions) if p not in self.arrivals]

    @property
    def complete(self) -> bool:
        """Whether all requests have arrived."""
        return len(self.arrivals) == self.partitions

    def in_order(self) -> list[Arrival]:
        """The arrivals by partition."""
        return [self.arrivals[p] for p in sorted(self.arrivals)]

    def repeats(self, arrival: Arrival) -> bool:
        """Whether this request already waits here.

        Raises SessionError: ABORTED.CONFLICT if a request with the same id but other content waits.
        """
        waiting = self.arrivals.get(arrival.request.partition)
        if waiting is None or _number(waiting) != _number(arrival):
            return False
        if waiting.request_id != arrival.request_id:
            raise SessionError(
                f"request {arrival.request.sequence} was already sent with other content",
                code="ABORTED.CONFLICT",
                hint="a new request needs a new sequence number",
            )
        return True

    def check_agreement(self, arrival: Arrival) -> None:
        """Raise INVALID_ARGUMENT.PARTITION unless the request agrees with the others."""
        other = next(iter(self.arrivals.values()))
        if agreement(other.request) == agreement(arrival.request):
            return
        p, q = other.request.partition, arrival.request.partition
        theirs, ours = _say(agreement(other.request)), _say(agreement(arrival.request))
        raise InvalidInput(
            f"the partitions send different requests: partition {p} for {theirs}, partition {q} for {ours}",
            code="INVALID_ARGUMENT.PARTITION",
            hint="all partitions must send the same collective request",
            details={"partitions": [p, q], "values": [theirs, ours]},
        )


def _number(arrival: Arrival) -> tuple[bytes, int]:
    return arrival.request.client, arrival.request.sequence


def _say(agreed: tuple[tuple[str, object], ...]) -> str:
    values: Mapping[str, object] = dict(agreed)
    return " ".join([str(values["type"]), *(f"{name} {value}" for name, value in agreed[1:])])
