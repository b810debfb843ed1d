"""A stream for the log that never blocks the process.

All processes of a server write to one standard error, which other programs may share, so this process cannot make it
non-blocking. So a line is written only when the stream is ready for it, and lost otherwise.
"""

from __future__ import annotations

import contextlib
import io
import os
import select
import stat
from typing import TextIO

#: A pipe that is ready for writing accepts this many bytes without blocking (POSIX: PIPE_BUF).
_PIECE = select.PIPE_BUF
#: Wait this long for a slow reader; after one wait without success, do not wait again until the reader reads.
_PATIENCE_MILLISECONDS = 200


class Unfailing(io.TextIOBase):
    """A stream that loses a line instead of failing or blocking."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._poll = _poll_of(stream)
        self._patience = _PATIENCE_MILLISECONDS

    def write(self, text: str) -> int:
        with contextlib.suppress(OSError, ValueError):
            if self._poll is None:
                self._stream.write(text)
            else:
                self._offer(self._poll, text.encode("utf-8", errors="replace"))
        return len(text)

    def _offer(self, poll: select.poll, data: bytes) -> None:
        """Write in pieces while each is accepted; drop the rest of the line otherwise."""
        descriptor = self._stream.fileno()
        for start in range(0, len(data), _PIECE):
            if not poll.poll(self._patience):
                self._patience = 0
                return
            os.write(descriptor, data[start : start + _PIECE])
            self._patience = _PATIENCE_MILLISECONDS

    def flush(self) -> None:
        with contextlib.suppress(OSError, ValueError):
            self._stream.flush()


def _poll_of(stream: TextIO) -> select.poll | None:
    """Return a poll object for writing; None for a file, which is always ready, or without a descriptor."""
    try:
        if stat.S_ISREG(os.fstat(stream.fileno()).st_mode):
            return None
    except (OSError, ValueError):
        return None
    poll = select.poll()
    poll.register(stream.fileno(), select.POLLOUT)
    return poll
