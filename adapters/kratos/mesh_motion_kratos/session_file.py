"""The file that leads a restarted run to its session: name, secret, and a digest of the session's settings."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path

from mesh_motion_client import Credentials
from mesh_motion_client.private_file import write_private

from mesh_motion_kratos.errors import SettingsError
from mesh_motion_kratos.settings import RemoteSettings

__all__ = ["StoredSession", "digest"]


@dataclass(frozen=True)
class StoredSession:
    """The content of a session file.

    Attributes
    ----------
    credentials : Credentials
        With them any client can resume the session, so only the file's owner may read it.
    opened_with : str
        :func:`digest` of the settings.
    """

    credentials: Credentials
    opened_with: str

    def save(self, path: Path) -> None:
        """Replace the file in one piece.

        Raises
        ------
        SettingsError
            The file cannot be written.
        """
        try:
            write_private(path, json.dumps(self.credentials.values() | {"opened_with": self.opened_with}))
        except OSError as error:
            raise SettingsError(f"the session file {path} cannot be written: {error.strerror}") from None

    @classmethod
    def load(cls, path: Path) -> StoredSession:
        """Read what :meth:`save` wrote.

        Raises
        ------
        SettingsError
            There is no such file, or it is not a session's file.
        """
        try:
            values = json.loads(path.read_text(encoding="ascii"))
            return cls(Credentials.of_values(values), str(values["opened_with"]))
        except OSError as error:
            raise SettingsError(f"the session file {path} cannot be read: {error.strerror}") from None
        except (ValueError, KeyError, TypeError) as error:
            raise SettingsError(f"the session file {path} is none: {error!r}") from None


def digest(settings: RemoteSettings) -> str:
    """SHA-256 of the settings that influence the computed meshes."""
    relevant = {"method": dict(settings.method), "roles": dict(settings.roles)}
    return hashlib.sha256(json.dumps(relevant, sort_keys=True).encode()).hexdigest()
