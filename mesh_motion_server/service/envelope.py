"""A message with its sender or its receiver."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from mesh_motion_protocol.messages import Message


@dataclass(frozen=True)
class Envelope:
    """A message with its sender or its receiver, the peer."""

    peer: bytes  # Transport's identifier of a connection; opaque here
    message: Message
    #: Memory that the peer offers for the arrays of this reply; may be empty.
    memory: Mapping[str, Any] = field(default_factory=dict)
