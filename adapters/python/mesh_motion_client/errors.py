"""The errors of the client, which server and numerics raise too: the classes of :mod:`mesh_motion_protocol`."""

from mesh_motion_protocol import errors
from mesh_motion_protocol.errors import *  # noqa: F403

_ROOTS = (errors.MeshMotionError, errors.MeshMotionWarning)
__all__ = [
    name for name in errors.__all__ if isinstance(kind := getattr(errors, name), type) and issubclass(kind, _ROOTS)
]
