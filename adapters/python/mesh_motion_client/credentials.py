"""What opens a session again, from another process or after a crash."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass, field
from pathlib import Path

from mesh_motion_client.errors import InvalidInput

__all__ = ["Credentials"]


@dataclass(frozen=True)
class Credentials:
    """A session's id and its secret.

    Attributes
    ----------
    session : str
        32 hexadecimal digits.
    token : bytes
        32 bytes. Whoever has them has the session.
    """

    session: str
    token: bytes = field(repr=False)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a file that only its owner may read."""
        target = Path(path)
        part = target.with_name(target.name + ".part")
        text = json.dumps({"session": self.session, "token": self.token.hex()})
        part.unlink(missing_ok=True)  # what is left of an earlier try has a mode and an owner of its own
        with open(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="ascii") as file:
            file.write(text + "\n")
        part.replace(target)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Credentials:
        """Read what :meth:`save` wrote.

        Raises
        ------
        InvalidInput
            If the file holds no credentials.
        """
        try:
            values = json.loads(Path(path).read_text(encoding="ascii"))
            return cls(str(values["session"]), bytes.fromhex(values["token"]))
        except (ValueError, KeyError, TypeError) as error:
            raise InvalidInput(f"{path} must hold a session and a token: {error}") from None
