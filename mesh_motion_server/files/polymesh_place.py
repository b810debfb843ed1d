"""Where the mesh of an OpenFOAM case lies: in ``constant/polyMesh``, its points of a time in ``<time>/polyMesh``."""

from __future__ import annotations

import os
import re
from pathlib import Path

__all__ = ["is_a_time", "target_folder"]

#: A time as OpenFOAM names folders: 0.5, 1e-05, 1e+06, and -180 where an engine counts degrees.
_TIME = re.compile(r"-?\d+(\.\d+)?([eE][+-]?\d+)?")


def target_folder(path: Path) -> Path:
    """Where the mesh of a case, of one of its times, or of a folder ``polyMesh``, belongs."""
    folder = path.parent if path.suffix == ".foam" else path
    if _whole(folder).name == "polyMesh":
        return folder
    return folder / "polyMesh" if is_a_time(folder) else folder / "constant" / "polyMesh"


def is_a_time(path: Path) -> bool:
    """Whether a path is a time directory of a case, which may be missing yet, or the folder ``polyMesh`` of one."""
    return any(_is_a_time(place) for place in (_whole(path), path.resolve()))


def _whole(path: Path) -> Path:
    """The path from the root on, with the names that links have, not those they lead to."""
    return Path(os.path.abspath(path))


def _is_a_time(place: Path) -> bool:
    """The same of a path from the root on; outside of a case, 1 may be a case's own name."""
    if place.name == "polyMesh":
        return _TIME.fullmatch(place.parent.name) is not None
    in_a_case = any((place.parent / name).is_dir() for name in ("constant", "system"))
    return _TIME.fullmatch(place.name) is not None and in_a_case and not (place / "constant").exists()
