"""Sessions of the real service with the stand-in's arithmetic: what a worker is given for proofs of all the rest."""

from __future__ import annotations

from typing import Any

from mesh_motion_server.prove.stand_in import StandIn
from mesh_motion_server.service import dispatch

__all__ = ["SessionHost"]

#: A model in all that a session asks of it, if not in its types.
_BUILD_MODEL: Any = StandIn


class SessionHost(dispatch.SessionHost):
    """A host whose sessions move by :class:`~.stand_in.StandIn`."""

    @classmethod
    def create(cls, *given: Any, **options: Any) -> SessionHost:
        """As :meth:`.dispatch.SessionHost.create`."""
        host: Any = super().create(*given, **{"build_model": _BUILD_MODEL} | options)
        return host  # type: ignore[no-any-return]

    @classmethod
    def resume(cls, *given: Any, **options: Any) -> SessionHost:
        """As :meth:`.dispatch.SessionHost.resume`."""
        host: Any = super().resume(*given, **{"build_model": _BUILD_MODEL} | options)
        return host  # type: ignore[no-any-return]
