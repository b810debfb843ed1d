"""Expected answers by role, written by hand from docs/security.md and SPEC.md (sections 10, 11.8 and 20).

They are not read from the server's own table: if the two differ, one of them is wrong, and a check fails.
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from itertools import combinations

_ON_CONTROL = ("HELLO", "PING", "OPEN", "LIST", "PROBE", "RESUME")
_ON_DATA = (
    "JOIN", "UPLOAD", "BUILD", "MOVE", "TANGENT", "COTANGENT", "JUDGE", "CORRECT", "COMMIT", "ROLLBACK", "FETCH",
    "STATUS", "CLOSE",
)  # fmt: skip

#: Request → the endpoint that takes it; PING is asked at both.
REQUESTS = (
    *((request, "control") for request in _ON_CONTROL),
    ("PING", "data"),
    *((request, "data") for request in _ON_DATA),
)

#: Everybody with a connection may ask who the server is and whether it lives.
_ANYBODY = {"HELLO", "PING"}
#: "others' sessions do not exist for it: NOT_FOUND, … and LIST leaves them out"
_OWNER = {
    True: dict.fromkeys(("OPEN", "LIST", "PROBE", "RESUME", *_ON_DATA), "use"),
    False: {"OPEN": "use"} | dict.fromkeys(("LIST", "PROBE", "RESUME", *_ON_DATA), "NOT_FOUND"),
}
#: "LIST, PROBE and STATUS of all sessions …; no mesh, no displacement, no coordinates; changes nothing"
_MONITOR = dict.fromkeys(("LIST", "PROBE", "STATUS"), "oversee")
#: "what a monitor may, and CLOSE any session"
_ADMIN = _MONITOR | {"CLOSE": "oversee"}
_BY_ROLE = {"owner": _OWNER, "monitor": {True: _MONITOR, False: _MONITOR}, "admin": {True: _ADMIN, False: _ADMIN}}
_BEST_FIRST = ("use", "oversee", "PERMISSION_DENIED", "NOT_FOUND")

#: "A key may have several roles": then each request has the best of their answers.
_ROLES = ("owner", "monitor", "admin")
COMBINATIONS = [roles for count in (1, 2, 3) for roles in combinations(_ROLES, count)]
#: Who gets no connection at all.
OUTSIDERS = ("no key", "unknown key", "wrong server key", "key taken off the list")


@dataclass(frozen=True)
class Cell:
    """One request: its sender, type, endpoint and session (True: a session of the sender)."""

    roles: tuple[str, ...]
    request: str
    endpoint: str
    own: bool

    def __str__(self) -> str:
        whose = "its own" if self.own else "another's"
        return f"{'+'.join(self.roles) or 'no role'}: {self.request} of {whose} session at {self.endpoint}"


def expected(roles: Collection[str], request: str, *, own: bool) -> str:
    """The answer: "use" (with token and JOIN), "oversee" (without), or an error's code.

    ``roles``: if empty, the key was removed from the list, while a connection is still open.
    """
    if not roles:
        return "UNAUTHENTICATED"
    if request in _ANYBODY:
        return "use"
    answers = {_BY_ROLE[role][own].get(request, "PERMISSION_DENIED") for role in roles}
    return min(answers, key=_BEST_FIRST.index)


def role_cells() -> Iterator[Cell]:
    """All requests of users with a connection: every combination of roles, and a key that was just removed."""
    for roles in (*COMBINATIONS, ()):
        for own in (True, False):
            for request, endpoint in REQUESTS:
                yield Cell(roles, request, endpoint, own)
