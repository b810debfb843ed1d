"""The errors of the adapter; the client's own (:class:`mesh_motion_client.MeshMotionError`) pass through it.

::

    KratosAdapterError
    ├── SettingsError  the block "remote" of the solver's settings is wrong
    ├── PartError      the model part cannot be taken as it is: its elements, its fixed nodes
    └── MotionError    no acceptable mesh was found for the boundary's motion; the committed mesh is as it was
"""

from __future__ import annotations

__all__ = ["KratosAdapterError", "MotionError", "PartError", "SettingsError"]


class KratosAdapterError(Exception):
    """Base of the adapter's errors.

    Parameters
    ----------
    message : str
        One line: what was expected, what was given, the first offender by Kratos' number.
    hint : str, optional
        What to do.
    """

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(f"{message} ({hint})" if hint else message)
        self.message = message
        self.hint = hint


class SettingsError(KratosAdapterError):
    """The settings are wrong; nothing was sent."""


class PartError(KratosAdapterError):
    """The model part cannot be taken as it is."""


class MotionError(KratosAdapterError):
    """The motion was refused; a smaller step may be accepted."""
