"""One mesh format: how to recognise its files, how to read them, and how to write them with moved nodes."""

import re
from collections.abc import Callable
from dataclasses import dataclass

from mesh_motion_server.files.mesh_file import MeshFile

#: Number of bytes at the beginning of a file that are searched to identify its format.
HEAD_BYTES = 4096


@dataclass(frozen=True, eq=False)
class Format:
    """A row of the table of formats."""

    name: str  # name in messages: "a Gmsh mesh"
    suffixes: tuple[str, ...]  # usual endings of its files, lower case; empty for folders
    #: Matches in the first :data:`HEAD_BYTES` bytes of every file of this format; for a folder in the names of its
    #: files, one on each line.
    head: re.Pattern[bytes]
    read: Callable[..., MeshFile] | None = None  # function (path) or (path, zone). Reads the file
    zoned: bool = False  # whether ``read`` and ``move`` take a zone
    #: function (source, target, points) or (source, target, points, zone). Writes a copy of ``source`` in
    #: which the nodes have the coordinates ``points`` (n, d), as read by ``read``.
    move: Callable[..., None] | None = None
    folder: bool = False  # whether it is a folder of files
    way_in: str = ""  # for a format that is not read: how to convert its files

    def fits(self, head: bytes) -> bool:
        """Whether a file with this beginning is of this format."""
        return self.head.search(head) is not None
