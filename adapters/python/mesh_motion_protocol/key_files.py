"""Keys in files: one line each, ``mesh-motion-public KEY NAME`` or ``mesh-motion-secret KEY NAME``.

A key is a Curve25519 key as 40 characters of Z85 (ZeroMQ RFC 32). A public key is no secret. A secret key proves who
its holder is: its file has mode 0600, and a file that others may read is refused.
"""

from __future__ import annotations

import os
import re
import stat
from dataclasses import dataclass, field
from pathlib import Path

__all__ = ["KeyFileError", "PublicKey", "SecretKey", "checked_key", "checked_name"]

_KEY = re.compile(r"[0-9a-zA-Z.\-:+=^!/*?&<>()\[\]{}@%$#]{40}")
_NAME = re.compile(r"[0-9a-zA-Z][0-9a-zA-Z._@-]{0,63}")
#: Largest size of a key file, which has one line: a longer file is something else.
_MOST_BYTES = 4096


class KeyFileError(ValueError):
    """A file holds no key, or is not protected as required; the message never shows a secret."""


@dataclass(frozen=True)
class PublicKey:
    """A public key: identifies the holder of the secret key.

    Attributes
    ----------
    key : str
        40 characters of Z85.
    """

    name: str
    key: str

    def save(self, path: Path) -> None:
        """Write a file that everybody may read; an existing file is an error."""
        _create(path, 0o644, f"mesh-motion-public {self.key} {self.name}\n")

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> PublicKey:
        """Read a file that :meth:`save` wrote.

        Raises
        ------
        KeyFileError
            If it is not readable or holds no public key.
        """
        return cls(*_parse(_read(Path(path), secret=False), "public", Path(path)))


@dataclass(frozen=True)
class SecretKey:
    """A secret key: proves who its holder is.

    Attributes
    ----------
    key : str
        40 characters of Z85; not shown.
    """

    name: str
    key: str = field(repr=False)

    def save(self, path: Path) -> None:
        """Write a file of mode 0600; an existing file is an error."""
        _create(path, 0o600, f"mesh-motion-secret {self.key} {self.name}\n")

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> SecretKey:
        """Read a file that :meth:`save` wrote.

        Raises
        ------
        KeyFileError
            If it is not readable, holds no secret key, or others may read it.
        """
        return cls(*_parse(_read(Path(path), secret=True), "secret", Path(path)))


def checked_key(text: str) -> str:
    """Return the text if it is a key.

    Raises
    ------
    KeyFileError
    """
    if not _KEY.fullmatch(text):
        raise KeyFileError("a key must be 40 characters of Z85")
    return text


def checked_name(text: str) -> str:
    """Return the text if it is a name of a key.

    Raises
    ------
    KeyFileError
    """
    if not _NAME.fullmatch(text):
        raise KeyFileError(
            f"a name must be at most 64 letters, digits and . _ @ -, beginning with a letter or digit, got {text!r:.80}"
        )
    return text


def _create(path: Path, mode: int, line: str) -> None:
    """Create a file with one line and this mode, whatever the umask."""
    try:
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
    except OSError as error:
        raise KeyFileError(f"{path}: cannot be made: {error.strerror}") from None
    with open(descriptor, "w", encoding="ascii") as file:
        os.fchmod(descriptor, mode)
        file.write(line)


def _read(path: Path, *, secret: bool) -> str:
    try:
        with path.open("rb") as file:
            mode = os.fstat(file.fileno()).st_mode
            if secret and stat.S_IMODE(mode) & 0o077:
                raise KeyFileError(
                    f"{path}: a secret key must be readable by its owner alone (mode 0600), got mode "
                    f"{stat.S_IMODE(mode):04o}; make a new key if others may have read it, then chmod 600"
                )
            return file.read(_MOST_BYTES).decode("ascii")
    except OSError as error:
        raise KeyFileError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise KeyFileError(f"{path}: holds no key") from None


def _parse(text: str, kind: str, path: Path) -> tuple[str, str]:
    """Return the name and the key in a file's only line."""
    words = text.split()
    if len(words) != 3 or words[0] != f"mesh-motion-{kind}" or not _KEY.fullmatch(words[1]):
        raise KeyFileError(f"{path}: expected one line 'mesh-motion-{kind} KEY NAME', as `mesh-motion keys` writes it")
    return checked_name(words[2]), words[1]
