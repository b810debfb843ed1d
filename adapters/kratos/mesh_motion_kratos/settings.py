"""The block ``"remote"`` of the mesh solver's settings."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

from mesh_motion_kratos.errors import SettingsError

__all__ = ["PART_ROLES", "RemoteSettings"]

#: The roles of a sub model part's nodes, except those with a fixed MESH_DISPLACEMENT, which are prescribed.
PART_ROLES = ("fixed", "slip", "symmetry")


@dataclass(frozen=True)
class RemoteSettings:
    """The server's endpoint and the settings that are sent to it.

    Attributes
    ----------
    endpoint : str
        ``tcp://HOST:PORT`` or ``ipc:///path``, with ``$NAME`` from the environment; empty: a private server.
    method : dict
        Settings of SPEC.md, section 14.
    roles : dict
        Sub model part → one of :data:`PART_ROLES`.
    session_file : str
        Where the session's name and secret are kept, so that a restarted run takes it up again; empty: the session
        is discarded at the end.
    timeout, compute_timeout : float
        Seconds for an answer to small requests, and to moves and commits.
    durability, label : str
        As :meth:`mesh_motion_client.Server.open` takes them.
    """

    endpoint: str = ""
    method: Mapping[str, Any] = field(default_factory=dict)
    roles: Mapping[str, str] = field(default_factory=dict)
    session_file: str = ""
    timeout: float = 60.0
    compute_timeout: float = 1800.0
    durability: str = ""
    label: str = ""

    @classmethod
    def from_json(cls, text: str) -> RemoteSettings:
        """Read the block as Kratos writes it.

        Raises
        ------
        SettingsError
            An unknown key, a value of the wrong type, an unknown role or an invalid time-out.
        """
        given = json.loads(text)
        known = {entry.name: getattr(cls(), entry.name) for entry in fields(cls)}
        for key, value in given.items():
            if key not in known:
                raise SettingsError(f'"remote" has no setting "{key}"', f"its settings: {', '.join(known)}")
            _check_type(key, value, known[key])
        read = cls(**given)
        for part, role in read.roles.items():
            if role not in PART_ROLES:
                raise SettingsError(f'the role of part "{part}" must be one of {", ".join(PART_ROLES)}, got {role!r}')
        return read

    @property
    def address(self) -> str:
        """The endpoint with values from the environment inserted.

        Raises
        ------
        SettingsError
            A variable is not set.
        """
        address = os.path.expandvars(self.endpoint)
        if "$" in address:
            raise SettingsError(f'the endpoint "{address}" names a variable that the environment does not have')
        return address


def _check_type(key: str, value: object, default: object) -> None:
    """Raise unless the value has the default's type; numbers must be positive, and an int is accepted as a float."""
    if isinstance(default, float):
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not value > 0:
            raise SettingsError(f'"{key}" must be a positive number of seconds, got {value!r}')
        return
    kind = str if isinstance(default, str) else dict
    if not isinstance(value, kind):
        raise SettingsError(f'"{key}" must be {"a text" if kind is str else "a block {...}"}, got {value!r}')
