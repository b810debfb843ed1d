"""The real session host and store with the stand-in for numerics: what a worker of :mod:`.stand_in_server` loads."""

from __future__ import annotations

from typing import Any, cast

from mesh_motion_server.prove.stand_in import StandIn
from mesh_motion_server.service.dispatch import SessionHost as RealHost
from mesh_motion_server.session.store import SessionStore

__all__ = ["SessionHost", "SessionStore"]

#: A model in all that a session asks of it, if not in its types.
_BUILD_MODEL: Any = StandIn


class SessionHost(RealHost):
    """The real one; its model is the stand-in."""

    @classmethod
    def create(cls, *arguments: Any, **options: Any) -> SessionHost:
        """As the real one."""
        return cast("SessionHost", super().create(*arguments, build_model=_BUILD_MODEL, **options))

    @classmethod
    def resume(cls, *arguments: Any, **options: Any) -> SessionHost:
        """As the real one."""
        return cast("SessionHost", super().resume(*arguments, build_model=_BUILD_MODEL, **options))
