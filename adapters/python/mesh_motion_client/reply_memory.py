"""Memory that is offered for the arrays of replies, and used again when its arrays are gone."""

from __future__ import annotations

from contextlib import suppress

import numpy as np
from mesh_motion_protocol.messages import Message
from mesh_motion_protocol.shared_memory import SharedMemory, is_large

__all__ = ["ReplyMemory"]

#: Who keeps the arrays of more replies gets the next ones through the socket.
_MOST = 4


class ReplyMemory:
    """What one session offers.

    The first reply shows how much is needed. Memory whose request was not answered is not given back: a worker that was
    given up may still write to it.
    """

    def __init__(self) -> None:
        self._all: list[SharedMemory] = []
        self._nbytes = 0

    def take(self) -> SharedMemory | None:
        """Memory for the next reply; None: offer nothing."""
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
        """A request was answered, with this memory offered for its arrays."""
        arrays = [value for value in vars(reply).values() if isinstance(value, np.ndarray) and is_large(value)]
        self._nbytes = sum(array.nbytes for array in arrays)
        if memory is not None:
            self._all.append(memory)
