"""One reader for every mesh file. The beginning of a file decides on its format; if it is unknown, the suffix."""

import os
from dataclasses import replace
from pathlib import Path

from mesh_motion_protocol.errors import InvalidInput
from mesh_motion_protocol.limits import NAME_BYTES

from mesh_motion_server.files.format import HEAD_BYTES, Format
from mesh_motion_server.files.formats import FORMATS
from mesh_motion_server.files.mesh_file import MeshFile
from mesh_motion_server.files.openfoam.polymesh import OPENFOAM

SUFFIXES = tuple(dict.fromkeys(suffix for one in FORMATS if one.read for suffix in one.suffixes))


def is_mesh(path: Path) -> bool:
    """Whether the path is a mesh and not a case file: a known suffix, or a folder."""
    return path.suffix.lower() in SUFFIXES or path.is_dir()


def read_mesh(path: Path | str, zone: str = "") -> MeshFile:
    """Read a mesh with its patches.

    Raises InvalidInput if the file is missing, of another format, damaged, or holds no usable mesh.

    Parameters
    ----------
    path : path
        A file or a folder of one of :data:`.formats.FORMATS`.
    zone : str
        The name or number of a zone, if the file has several.
    """
    path = Path(path)
    found = format_of(path)
    if found.read is None:
        raise InvalidInput(f"{path}: {found.name}, which is not read", hint=found.way_in)
    if zone and not found.zoned:
        raise InvalidInput(f"{path}: zone {zone!r} is asked for, but {found.name} has no zones", hint="leave zone out")
    try:
        return _with_names(found.read(path, zone) if found.zoned else found.read(path))
    except OSError as error:
        raise InvalidInput(f"{path}: cannot be read: {error.strerror or error}") from None


def _with_names(mesh: MeshFile) -> MeshFile:
    """The mesh without patches whose name no session can have."""
    sizes = {name: len(name.encode(errors="replace")) for name in mesh.patches}
    odd = [name for name, size in sizes.items() if not 0 < size <= NAME_BYTES]
    if not odd:
        return mesh
    patches = {name: nodes for name, nodes in mesh.patches.items() if name not in odd}
    notes = [
        f"the patch {name[:40]!r} is left out: its name has {sizes[name]} bytes, expected 1 to {NAME_BYTES}"
        for name in odd
    ]
    return replace(mesh, patches=patches, notes=(*mesh.notes, *notes))


def format_of(path: Path) -> Format:
    """Return the format of a file or folder.

    A file whose beginning fits no format gets the format of its suffix, if only one format has this suffix: its reader
    then says what is wrong. A folder that fits no format gets OpenFOAM's. Raises InvalidInput if there is no such file,
    or no format fits.
    """
    suffix, folder = path.suffix.lower(), path.is_dir()
    if not folder and not path.is_file():
        raise InvalidInput(f"{path}: no such mesh file", hint="paths in a case file are relative to the case file")
    head = _head(path)
    formats = [one for one in FORMATS if one.folder == folder]
    usual = [one for one in formats if suffix in one.suffixes]
    for one in (*usual, *formats):
        if one.fits(head):
            return one
    if len(usual) == 1:
        return usual[0]
    if folder:
        return OPENFOAM
    if usual:
        names = " nor ".join(one.name for one in usual)
        other = "another program's? docs/files.md lists what is read: export one of these"
        raise InvalidInput(f"{path}: neither {names}: it begins with {head[:40]!r}", hint=other)
    known = f"known are {', '.join(SUFFIXES)} and OpenFOAM's folders"
    raise InvalidInput(f"{path}: unknown kind of mesh file; {known}", hint="a case file is named .toml")


def _head(path: Path) -> bytes:
    """The beginning of a file; the names in a folder, one a line."""
    try:
        if path.is_dir():
            return b"\n".join(sorted(os.listdir(os.fsencode(path))))
        with path.open("rb") as file:
            return file.read(HEAD_BYTES)
    except OSError as error:
        raise InvalidInput(f"{path}: cannot be read: {error.strerror or error}") from None
