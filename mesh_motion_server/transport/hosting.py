"""What transport needs of the layers below it: a host for one session, and the store of all of them.

Given by module name, so that the supervisor imports no numerics and a test may put a host of its own in.
"""

from __future__ import annotations

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
        """Where the session stands."""

    @property
    def closed(self) -> bool:
        """CLOSE was answered."""

    @property
    def next_deadline(self) -> float | None:
        """When :meth:`expire` will have something to do, on the monotonic clock."""

    def handle(self, envelope: Envelope) -> Sequence[Envelope]:
        """Replies that are due because of this request."""

    def oversee(self, envelope: Envelope) -> Sequence[Envelope]:
        """Replies to STATUS or CLOSE of a user who may make them without having joined."""

    def expire(self, now: float) -> Sequence[Envelope]:
        """Replies to requests that waited too long."""

    def reclaim(self, token: bytes) -> int:
        """Raise the epoch for a new holder."""

    def suspend(self) -> Sequence[Envelope]:
        """No holder is connected any more."""

    def close(self) -> None:
        """Give files and locks back."""


@dataclass(frozen=True)
class Hosting:
    """The modules that provide ``SessionHost`` and ``SessionStore``, and what else a worker imports ahead."""

    host: str = "mesh_motion_server.service.dispatch"
    store: str = "mesh_motion_server.session.store"
    numerics: str = "mesh_motion_server.numerics.motion.motion"

    def load_host(self) -> Any:
        """The class ``SessionHost``, with everything imported that its first request needs."""
        importlib.import_module(self.numerics)
        return importlib.import_module(self.host).SessionHost

    def load_store(self) -> Any:
        """The class ``SessionStore``."""
        return importlib.import_module(self.store).SessionStore
