"""The places of sessions with a worker: their number, and the session that gives its place to another one.

A session whose lease has ended needs no worker: it is stored, and RESUME starts another worker. So the session that has
been suspended for longest gives its place to a request that finds no place, port or memory for its own worker.
"""

from mesh_motion_protocol.errors import MeshMotionError, ResourceExhausted

from mesh_motion_server.settings import ServerSettings
from mesh_motion_server.transport.registry import Live, Registry

__all__ = ["check_place", "gives_way"]

_NO_PLACE = "RESOURCE_EXHAUSTED.SESSIONS"


class QuotaReached(ResourceExhausted):
    """A user has as many sessions as each user may have; only another session of the same user can give its place."""

    def __init__(self, user: str, most: int) -> None:
        super().__init__(
            f"{most} sessions of this key are open, which is the limit of each key on this server",
            code=_NO_PLACE,
            hint="close one, or raise max_sessions_per_key",
            details={"expected": most},
        )
        self.user = user


def check_place(registry: Registry, settings: ServerSettings, user: str) -> None:
    """Raise if there is no place for one more worker, or none for this user.

    Raises
    ------
    ResourceExhausted
        RESOURCE_EXHAUSTED.SESSIONS.
    """
    working, most = registry.working(), settings.max_sessions_per_key
    if user and most is not None and sum(live.owner == user for live in working) >= most:
        raise QuotaReached(user, most)
    if len(working) >= settings.max_sessions:
        raise ResourceExhausted(
            f"{settings.max_sessions} sessions are open, which is the limit of this server",
            code=_NO_PLACE,
            hint="close one, or raise max_sessions",
            details={"expected": settings.max_sessions},
        )


def gives_way(registry: Registry, error: MeshMotionError) -> Live | None:
    """Return the session that gives its place to the request refused with this error, and mark it; None if none can."""
    if error.code != _NO_PLACE:
        return None
    owner = error.user if isinstance(error, QuotaReached) else None
    live = min((live for live in registry.working() if _may(live, owner)), key=_since, default=None)
    if live is not None:
        live.giving_way = True
    return live


def _may(live: Live, owner: str | None) -> bool:
    idle = live.status == "alive" and live.suspended_at is not None and live.asked is None
    return idle and not live.giving_way and owner in (None, live.owner)


def _since(live: Live) -> float:
    return live.suspended_at or 0.0
