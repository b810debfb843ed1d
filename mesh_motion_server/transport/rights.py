"""Which requests a user may make to one worker's session."""

from __future__ import annotations

import zmq
from mesh_motion_protocol.messages import Message

from mesh_motion_server.security.authorisation import Verdict, decide, refusal
from mesh_motion_server.transport.protection import Protection, user_of

__all__ = ["Rights"]


class Rights:
    """The allow-list and the session's owner, checked at every request.

    Parameters
    ----------
    protection : Protection or None
        None: a server without keys, where everybody is the owner.
    owner : str
        The public key of the user who opened the session.
    """

    def __init__(self, protection: Protection | None, owner: str) -> None:
        self._protection = protection
        self._access = Protection.access(protection)
        self._owner = owner

    def user(self, frame: zmq.Frame) -> str:
        """Return the public key of the message's connection."""
        return user_of(frame, self._protection)

    def is_owner(self, user: str) -> bool:
        """Whether this user owns the session."""
        return user == self._owner

    def check(self, user: str, request: Message) -> Verdict:
        """Return USE or OVERSEE.

        Raises
        ------
        SessionError
            UNAUTHENTICATED for a key taken off the list, NOT_FOUND or PERMISSION_DENIED as the table says, UNAVAILABLE
            while the allow-list cannot be used.
        """
        verdict = decide(self._access.roles(user), request.type, own=self.is_owner(user))
        if verdict not in (Verdict.USE, Verdict.OVERSEE):
            raise refusal(verdict, request.type, getattr(request, "session", ""))
        return verdict
