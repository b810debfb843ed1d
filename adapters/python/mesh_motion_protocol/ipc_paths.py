"""Places of ipc sockets: the kernel limits the length of their paths."""

from __future__ import annotations

import os
import tempfile

__all__ = ["PATH_BYTES", "PREFIX", "folder_for_sockets"]

#: Longest path in the kernel's ``sun_path``, without its final zero byte.
PATH_BYTES = 107
#: Prefix of private folders that are made for sockets.
PREFIX = "mesh-motion-"
_RANDOM = "x" * 8


def folder_for_sockets(name: str) -> str:
    """Return the folder for a socket's private folder: TMPDIR, or /tmp if the socket's path would be too long."""
    folder = tempfile.gettempdir()
    fits = len(os.fsencode(f"{folder}/{PREFIX}{_RANDOM}/{name}")) <= PATH_BYTES
    return folder if fits else "/tmp"
