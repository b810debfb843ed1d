"""What OPEN fixes for a session's whole life."""

from __future__ import annotations

from dataclasses import dataclass, field

from mesh_motion_server.settings import MethodSettings

__all__ = ["SessionSpec"]


@dataclass(frozen=True)
class SessionSpec:
    """What OPEN fixes for a session's whole life.

    Attributes
    ----------
    session : str
        32 hexadecimal digits.
    token : bytes
        32 bytes; only its sha256 is ever stored.
    dimension, partitions : int
    settings : MethodSettings
    label : str
    durability : str
        One of :data:`mesh_motion_server.settings.DURABILITY_LEVELS`.
    """

    session: str
    token: bytes = field(repr=False)
    dimension: int
    partitions: int = 1
    settings: MethodSettings = field(default_factory=MethodSettings)
    label: str = ""
    durability: str = "full"
