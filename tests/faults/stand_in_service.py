"""The real session host and store with the stand-in's arithmetic, for a worker of :mod:`.stand_in_server`.

A session whose label begins with ``real`` has the real numerics.
"""

from __future__ import annotations

from typing import Any

from mesh_motion_server.service import dispatch
from mesh_motion_server.session.spec import SessionSpec
from mesh_motion_server.session.store import SessionStore
from mesh_motion_server.transport import template
from mesh_motion_server.transport.channel import Channel
from tests.faults.stand_in import StandIn

__all__ = ["REAL", "SessionHost", "SessionStore", "main"]

#: How the label of a session with the real numerics begins.
REAL = "real"
#: A model in all that a session asks of it, if not in its types.
_STAND_IN: Any = StandIn


class SessionHost(dispatch.SessionHost):
    """A host whose sessions move by :class:`~.stand_in.StandIn`."""

    @classmethod
    def create(cls, spec: SessionSpec, store: SessionStore, **options: Any) -> SessionHost:
        """As :meth:`.dispatch.SessionHost.create`."""
        host: Any = super().create(spec, store, **_model(spec.label) | options)
        return host  # type: ignore[no-any-return]

    @classmethod
    def resume(cls, session: str, token: bytes, store: SessionStore, **options: Any) -> SessionHost:
        """As :meth:`.dispatch.SessionHost.resume`."""
        label = store.check_token(session, token).label
        host: Any = super().resume(session, token, store, **_model(label) | options)
        return host  # type: ignore[no-any-return]


def _model(label: str) -> dict[str, Any]:
    return {} if label.startswith(REAL) else {"build_model": _STAND_IN}


def main(channel: Channel, level: str) -> int:
    return template.main(channel, level, lambda: (SessionHost, SessionStore))
