"""The credentials that open a session again, from another process or after a crash."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_client.private_file import write_private

__all__ = ["Credentials"]


@dataclass(frozen=True)
class Credentials:
    """A session's id and its secret.

    Attributes
    ----------
    session : str
        32 hexadecimal digits.
    token : bytes
        32 bytes. They give full access to the session: keep them secret.
    """

    session: str
    token: bytes = field(repr=False)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a file that only its owner may read."""
        write_private(path, json.dumps(self.values()))

    def values(self) -> dict[str, str]:
        """Return the values that :meth:`save` writes."""
        return {"session": self.session, "token": self.token.hex()}

    @classmethod
    def of_values(cls, values: Mapping[str, Any]) -> Credentials:
        """Return the credentials with these values of :meth:`values`.

        Raises
        ------
        ValueError, KeyError, TypeError
            If the values are not credentials.
        """
        return cls(str(values["session"]), bytes.fromhex(values["token"]))

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Credentials:
        """Read a file that :meth:`save` wrote.

        Raises
        ------
        InvalidInput
            If the file holds no credentials.
        """
        try:
            return cls.of_values(json.loads(Path(path).read_text(encoding="ascii")))
        except (ValueError, KeyError, TypeError, RecursionError) as error:
            raise InvalidInput(f"{path} must hold a session and a token: {error}") from None
