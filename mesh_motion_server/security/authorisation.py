"""The rights of each role: which requests it may make on its own session and on another user's session, in one table.

SPEC.md shows it, and a test checks every cell over real sockets. A user with several roles has the best right of all of
them. A key that is not on the allow-list has no role and gets no connection. A removed key gets the answer
UNAUTHENTICATED from its next request on.
"""

from __future__ import annotations

from collections.abc import Collection
from enum import Enum, StrEnum

from mesh_motion_protocol.errors import SessionError


class Role(StrEnum):
    """The purpose of a key."""

    OWNER = "owner"
    MONITOR = "monitor"
    ADMIN = "admin"


class Verdict(Enum):
    """The decision on a request, the best first.

    Attributes
    ----------
    USE
        Allowed, if the session's token (PROBE, RESUME, JOIN) or an earlier JOIN permits it too.
    OVERSEE
        Allowed without token and JOIN: PROBE, and STATUS without coordinates, are answered; CLOSE ends the whole
        session.
    DENIED, HIDDEN, UNKNOWN
        Answered with this code; HIDDEN as if there were no such session.
    """

    USE = "yes"
    OVERSEE = "yes, without token and JOIN"
    DENIED = "PERMISSION_DENIED"
    HIDDEN = "NOT_FOUND"
    UNKNOWN = "UNAUTHENTICATED"


ROLES = frozenset(role.value for role in Role)
#: Requests that concern no session; their two columns are equal.
NO_SESSION = frozenset({"HELLO", "PING", "OPEN"})

_YES, _SEES, _NO, _HID = Verdict.USE, Verdict.OVERSEE, Verdict.DENIED, Verdict.HIDDEN
_ARRAYS = ("JOIN", "UPLOAD", "BUILD", "MOVE", "TANGENT", "COTANGENT", "JUDGE", "CORRECT", "COMMIT", "ROLLBACK", "FETCH")

#: Role → request → (verdict on an own session, on another user's). LIST: whether the session is in the list.
MATRIX: dict[Role, dict[str, tuple[Verdict, Verdict]]] = {
    Role.OWNER: {
        "HELLO": (_YES, _YES), "PING": (_YES, _YES), "OPEN": (_YES, _YES), "LIST": (_YES, _HID),
        "PROBE": (_YES, _HID), "RESUME": (_YES, _HID), **dict.fromkeys(_ARRAYS, (_YES, _HID)),
        "STATUS": (_YES, _HID), "CLOSE": (_YES, _HID),
    },
    Role.MONITOR: {
        "HELLO": (_YES, _YES), "PING": (_YES, _YES), "OPEN": (_NO, _NO), "LIST": (_SEES, _SEES),
        "PROBE": (_SEES, _SEES), "RESUME": (_NO, _NO), **dict.fromkeys(_ARRAYS, (_NO, _NO)),
        "STATUS": (_SEES, _SEES), "CLOSE": (_NO, _NO),
    },
    Role.ADMIN: {
        "HELLO": (_YES, _YES), "PING": (_YES, _YES), "OPEN": (_NO, _NO), "LIST": (_SEES, _SEES),
        "PROBE": (_SEES, _SEES), "RESUME": (_NO, _NO), **dict.fromkeys(_ARRAYS, (_NO, _NO)),
        "STATUS": (_SEES, _SEES), "CLOSE": (_SEES, _SEES),
    },
}  # fmt: skip
_ORDER = tuple(Verdict)


def decide(roles: Collection[str], request: str, *, own: bool) -> Verdict:
    """Return the decision on a request of a user with these roles; a request that is not in the table is denied.

    Parameters
    ----------
    request : str
        Type of the request.
    own : bool
        Whether it concerns a session of this user.
    """
    if not roles:
        return Verdict.UNKNOWN
    cells = [MATRIX[Role(role)].get(request) for role in roles]
    return min((cell[not own] for cell in cells if cell), key=_ORDER.index, default=Verdict.DENIED)


def refusal(verdict: Verdict, request: str, session: str = "") -> SessionError:
    """Return the error for a verdict that does not allow the request."""
    if verdict is Verdict.HIDDEN:
        return not_found(session)
    if verdict is Verdict.UNKNOWN:
        return SessionError(
            "this key is not on the server's allow-list",
            code="UNAUTHENTICATED",
            hint="the operator admits a key with `mesh-motion keys allow`",
        )
    return SessionError(
        f"the roles of this key do not allow {request}",
        code="PERMISSION_DENIED",
        hint="the operator gives roles with `mesh-motion keys allow`",
    )


def not_found(session: str) -> SessionError:
    """Return the same error for an unknown session, a wrong token, and another user's session."""
    return SessionError(
        f"there is no session {session!r:.40} for this sender",
        code="NOT_FOUND",
        hint="check the session id and its token; a session that was never built cannot be resumed",
    )
