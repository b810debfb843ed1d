"""Where ipc sockets lie: the kernel limits the length of their paths."""

from __future__ import annotations

import os
import tempfile

__all__ = ["PATH_BYTES", "PREFIX", "folder_for_sockets"]

#: Longest path in the kernel's ``sun_path``, without its final zero.
PATH_BYTES = 107
#: Of private folders that are made for sockets.
PREFIX = "mesh-motion-"
_RANDOM = "x" * 8


def folder_for_sockets(name: str) -> str:
    """Return where to make a private folder for such a socket: TMPDIR, or /tmp if its path would be too long."""
    folder = tempfile.gettempdir()
    fits = len(os.fsencode(f"{folder}/{PREFIX}{_RANDOM}/{name}")) <= PATH_BYTES
    return folder if fits else "/tmp"
