"""A log that stops nobody: its disk may be full, its reader may have gone, or may have stopped reading.

All processes of a server write to one standard error, which others may share: it cannot be made non-blocking for
ourselves alone. So a line is written to what says that it takes one, and lost otherwise.
"""

from __future__ import annotations

import contextlib
import io
import os
import select
import stat
from typing import TextIO

__all__ = ["Unfailing"]

#: A pipe that says it can be written to takes so much without waiting (POSIX: PIPE_BUF).
_PIECE = select.PIPE_BUF
#: Whoever reads slowly is waited for so long; whoever was waited for in vain is not waited for again until he reads.
_PATIENCE_MILLISECONDS = 200


class Unfailing(io.TextIOBase):
    """A stream that loses a line rather than fail or wait.

    Parameters
    ----------
    stream : TextIO
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._poll = _poll_of(stream)
        self._patience = _PATIENCE_MILLISECONDS

    def write(self, text: str) -> int:
        """See :class:`io.TextIOBase`."""
        with contextlib.suppress(OSError, ValueError):
            if self._poll is None:
                self._stream.write(text)
            else:
                self._offer(self._poll, text.encode("utf-8", errors="replace"))
        return len(text)

    def _offer(self, poll: select.poll, data: bytes) -> None:
        """Piece by piece, as long as each is taken; the rest of a line that is not taken is lost."""
        descriptor = self._stream.fileno()
        for start in range(0, len(data), _PIECE):
            if not poll.poll(self._patience):
                self._patience = 0
                return
            os.write(descriptor, data[start : start + _PIECE])
            self._patience = _PATIENCE_MILLISECONDS

    def flush(self) -> None:
        """See :class:`io.TextIOBase`."""
        with contextlib.suppress(OSError, ValueError):
            self._stream.flush()


def _poll_of(stream: TextIO) -> select.poll | None:
    """Asks whether the stream can be written to; None for a file, which always can, and for what is no descriptor."""
    try:
        if stat.S_ISREG(os.fstat(stream.fileno()).st_mode):
            return None
    except (OSError, ValueError):
        return None
    poll = select.poll()
    poll.register(stream.fileno(), select.POLLOUT)
    return poll
