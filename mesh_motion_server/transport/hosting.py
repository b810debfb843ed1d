"""What transport needs of the layers below it: a host for one session, and the store of all sessions.

Both are given by module name, so that the supervisor imports no numerics and a test may use its own host.
"""

import importlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from mesh_motion_server.service.envelope import Envelope

__all__ = ["Hosting", "SessionHost"]


class SessionHost(Protocol):
    """One session, as :mod:`mesh_motion_server.service.dispatch` describes it."""

    session: str
    label: str
    partitions: int
    epoch: int
    step: int

    @property
    def state(self) -> str:
        """The session's state."""

    @property
    def closed(self) -> bool:
        """Whether CLOSE was answered."""

    @property
    def next_deadline(self) -> float | None:
        """When :meth:`expire` must run next, on the monotonic clock."""

    def handle(self, envelope: Envelope) -> Sequence[Envelope]:
        """Return the replies that this request causes."""

    def oversee(self, envelope: Envelope) -> Sequence[Envelope]:
        """Return the replies to STATUS or CLOSE of a user who may send them without JOIN."""

    def expire(self, now: float) -> Sequence[Envelope]:
        """Return the replies to requests that waited too long."""

    def reclaim(self, token: bytes) -> int:
        """Raise the epoch for a new holder and return it."""

    def suspend(self) -> Sequence[Envelope]:
        """Suspend the session: no holder is connected any more."""

    def close(self) -> None:
        """Release files and locks."""


@dataclass(frozen=True)
class Hosting:
    """The modules that provide ``SessionHost`` and ``SessionStore``, and modules that a worker imports in advance."""

    host: str = "mesh_motion_server.service.dispatch"
    store: str = "mesh_motion_server.session.store"
    numerics: str = "mesh_motion_server.numerics.motion.motion"

    def load_host(self) -> Any:
        """Return the class ``SessionHost``, with everything imported that its first request needs."""
        importlib.import_module(self.numerics)
        return importlib.import_module(self.host).SessionHost

    def load_store(self) -> Any:
        """Return the class ``SessionStore``."""
        return importlib.import_module(self.store).SessionStore
