"""The errors of the client, which are those of server and numerics too: :mod:`mesh_motion_protocol.errors`."""

from mesh_motion_protocol.errors import (
    DataLoss,
    InvalidInput,
    MeshMotionError,
    MeshMotionWarning,
    QualityRefused,
    ResourceExhausted,
    ServerFault,
    SessionError,
    StepsLost,
    Timeout,
    Unavailable,
    Unsupported,
)

__all__ = [
    "DataLoss",
    "InvalidInput",
    "MeshMotionError",
    "MeshMotionWarning",
    "QualityRefused",
    "ResourceExhausted",
    "ServerFault",
    "SessionError",
    "StepsLost",
    "Timeout",
    "Unavailable",
    "Unsupported",
]
