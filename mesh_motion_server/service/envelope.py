"""A message with the peer it came from or goes to."""

from __future__ import annotations

from dataclasses import dataclass

from mesh_motion_protocol.messages import Message

__all__ = ["Envelope"]


@dataclass(frozen=True)
class Envelope:
    """A message and the peer it came from or goes to.

    Attributes
    ----------
    peer : bytes
        Whatever transport identifies a connection by; opaque here.
    message : Message
    """

    peer: bytes
    message: Message
