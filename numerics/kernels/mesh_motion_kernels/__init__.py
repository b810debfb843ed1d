"""The compiled loops of the mesh-motion server, for the vector width of this machine.

Results do not depend on the width. :data:`LEVEL` is the level in use; the environment variable ``MESH_MOTION_LEVEL``
selects a narrower one (``v2``, ``v3``, ``v4``; machines other than x86-64 have only ``base``). The headers in
``kernels/src`` describe the functions, their arrays and errors.
"""

from __future__ import annotations

import importlib
import os
from pathlib import Path
from typing import Any

from mesh_motion_kernels._machine import level as _widest

__all__ = ["LEVEL"]


def _chosen() -> str:
    """Return the widest level that was built and runs on this machine, or the requested one."""
    built = sorted(found.name for found in Path(__file__).parent.iterdir() if found.is_dir() and found.name[0] in "bv")
    fit = [name for name in built if name <= _widest()]
    asked = os.environ.get("MESH_MOTION_LEVEL") or max(fit, default="")
    if asked not in fit:
        raise ImportError(f"MESH_MOTION_LEVEL: {asked or 'no level'} cannot run here, expected one of {fit} of {built}")
    return asked


LEVEL = _chosen()
_loops = importlib.import_module(f"{__name__}.{LEVEL}._kernels")
globals().update({name: found for name, found in vars(_loops).items() if not name.startswith("_")})


def __getattr__(name: str) -> Any:
    raise AttributeError(
        f"module {__name__!r} has no attribute {name!r}: the extension is older than its callers, build it again"
    )
