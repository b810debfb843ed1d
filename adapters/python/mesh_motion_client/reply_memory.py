"""Memory that is offered for the arrays of replies, and reused when those arrays are deleted."""

from __future__ import annotations

from contextlib import suppress

import numpy as np
from mesh_motion_protocol.messages import Message
from mesh_motion_protocol.shared_memory import SharedMemory, is_large

__all__ = ["ReplyMemory"]

#: Largest number of memories: users who keep the arrays of more replies get further replies through the socket.
_MOST = 4


class ReplyMemory:
    """The memory that one session offers.

    The first reply shows how many bytes are needed. The memory of an unanswered request is not used again: a worker
    that was given up may still write to it.
    """

    def __init__(self) -> None:
        self._all: list[SharedMemory] = []
        self._nbytes = 0

    def take(self) -> SharedMemory | None:
        """Return memory for the next reply; None: offer no memory."""
        if not self._nbytes:
            return None
        for memory in self._all:
            if memory.holds(self._nbytes):
                self._all.remove(memory)
                return memory
        if len(self._all) < _MOST:
            with suppress(OSError):
                return SharedMemory(self._nbytes)
        return None

    def give_back(self, memory: SharedMemory | None, reply: Message) -> None:
        """Take back the memory that was offered with an answered request."""
        arrays = [value for value in vars(reply).values() if isinstance(value, np.ndarray) and is_large(value)]
        self._nbytes = sum(array.nbytes for array in arrays)
        if memory is not None:
            self._all.append(memory)
