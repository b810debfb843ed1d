"""The allow-list: public key → name and roles, in a TOML file that is checked at every use.

::

    [keys]
    "Yne@$w-vo<fVvi]a<NY6T1ed:M$fCG*[IaLV{hID" = { name = "alice", roles = ["owner"] }

A check costs one ``stat``; the file is read again when it has been replaced or changed. So a key that is removed from
the list has lost its rights by the next request, also on open connections. While the file cannot be read, is wrong, or
could be written by others, no key is admitted: requests are answered UNAVAILABLE, and the log has the reason.
"""

from __future__ import annotations

import logging
import os
import stat
import time
import tomllib
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from mesh_motion_protocol.errors import InvalidInput, SessionError
from mesh_motion_protocol.key_files import KeyFileError, checked_key, checked_name

from mesh_motion_server.security.authorisation import ROLES, Role
from mesh_motion_server.toml import read_toml

_LOG = logging.getLogger(__name__)
#: Two writes within one tick of the clock have the same stat: files younger than this are read again.
_SETTLED_NANOSECONDS = 50_000_000
#: Thousands of keys fit; a larger file is a mistake, and reading it would delay every request.
_MOST_BYTES = 1 << 20
_HEADER = """\
# Who may connect: public key = name and roles (owner, monitor, admin). `mesh-motion keys allow` and `revoke` rewrite
# this file; a running server sees a change at the next request.

[keys]
"""


@dataclass(frozen=True)
class Entry:
    """One admitted key: its holder's name and its roles."""

    name: str
    roles: tuple[str, ...] = (Role.OWNER.value,)


class Access(Protocol):
    """The roles of each user."""

    def roles(self, key: str) -> tuple[str, ...]:
        """Return the roles of a public key; none for an unknown key."""

    def name(self, key: str) -> str:
        """Return the name of a public key's holder, for lists and logs."""


class Everybody:
    """A server without keys: all users are the same owner."""

    def roles(self, key: str) -> tuple[str, ...]:
        """Return the owner role."""
        return () if key else (Role.OWNER.value,)

    def name(self, key: str) -> str:
        """Return an empty name."""
        return key


class AllowList:
    """A file with the admitted keys."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._seen: tuple[int, ...] = ()
        self._entries: Mapping[str, Entry] = {}
        self._failure = ""

    def entry(self, key: str) -> Entry | None:
        """Return the entry of this key, None for an unknown key.

        Raises SessionError: UNAVAILABLE while the file cannot be used.
        """
        self._look()
        if self._failure:
            raise SessionError(
                "the server's allow-list cannot be used at present, so no key is admitted",
                code="UNAVAILABLE",
                hint="the server's log says why",
            )
        return self._entries.get(key)

    def roles(self, key: str) -> tuple[str, ...]:
        """Return the roles of a key, none for an unknown key; raises like :meth:`entry`."""
        entry = self.entry(key)
        return entry.roles if entry else ()

    def name(self, key: str) -> str:
        """Return the holder's name; the key itself if it is no longer on the list."""
        return self._entries[key].name if key in self._entries else key

    def _look(self) -> None:
        """Read the file again if it has changed since the last read."""
        try:
            status = os.stat(self._path)
            seen = (status.st_ino, status.st_size, status.st_mtime_ns, status.st_ctime_ns, status.st_mode)
            if seen == self._seen:
                return
            entries = read_entries(self._path)
        except (OSError, InvalidInput) as error:
            self._seen = ()
            if str(error) != self._failure:
                self._failure = str(error)
                _LOG.error("allow-list unusable, no key is admitted: %s", error)
            return
        if entries != self._entries or self._failure:
            _LOG.info("allow-list read: %d keys", len(entries))
        self._entries, self._failure = entries, ""
        settled = abs(time.time_ns() - status.st_mtime_ns) > _SETTLED_NANOSECONDS
        self._seen = seen if settled else ()


def read_entries(path: Path) -> dict[str, Entry]:
    """Read the keys of a file.

    Raises InvalidInput if it is not an allow-list, or others may write it. Raises OSError if it cannot be read.
    """
    with path.open("rb") as file:
        status = os.fstat(file.fileno())
        if status.st_uid not in (os.geteuid(), 0) or stat.S_IMODE(status.st_mode) & 0o022:
            raise InvalidInput(f"{path}: an allow-list must be writable by its owner alone", hint="chmod 644 it")
        text = file.read(_MOST_BYTES + 1)
    if len(text) > _MOST_BYTES:
        raise InvalidInput(f"{path}: an allow-list must have at most {_MOST_BYTES} bytes")
    try:
        content = read_toml(text.decode("utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InvalidInput(f"{path}: not readable as TOML: {error}") from None
    unknown = sorted(content.keys() - {"keys"})
    if unknown or not isinstance(content.get("keys"), dict):
        raise InvalidInput(f"{path}: an allow-list must have the table [keys] only, got {unknown or sorted(content)}")
    entries = {key: _entry(path, key, value) for key, value in content["keys"].items()}
    names = Counter(entry.name for entry in entries.values())
    twice = [name for name, count in names.items() if count > 1]
    if twice:
        raise InvalidInput(f"{path}: the name {twice[0]!r} belongs to two keys")
    return entries


def _entry(path: Path, key: str, value: Any) -> Entry:
    """Check and return one line of the table."""
    try:
        checked_key(key)
        if not isinstance(value, dict) or value.keys() != {"name", "roles"} or not isinstance(value["name"], str):
            raise KeyFileError("expected { name = …, roles = […] }")
        checked_name(value["name"])
    except KeyFileError as error:
        raise InvalidInput(f"{path}: key {key!r:.60}: {error}") from None
    roles = value["roles"]
    if not isinstance(roles, list) or not roles or not all(isinstance(r, str) and r in ROLES for r in roles):
        raise InvalidInput(f"{path}: roles of {value['name']!r} must be some of {', '.join(Role)}, got {roles!r:.80}")
    return Entry(value["name"], tuple(dict.fromkeys(roles)))


def write_entries(path: Path, entries: Mapping[str, Entry]) -> None:
    """Replace the file as a whole, so that a reader never sees half of it. Raises OSError."""
    lines = [_line(key, entry) for key, entry in sorted(entries.items(), key=lambda item: item[1].name)]
    part = path.with_name(path.name + ".part")
    with open(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644), "w", encoding="utf-8") as file:
        file.write(_HEADER + "".join(lines))
        file.flush()
        os.fsync(file.fileno())
    part.replace(path)


def _line(key: str, entry: Entry) -> str:
    """Format one line; neither Z85 nor names contain characters that a TOML string must escape."""
    roles = ", ".join(f'"{role}"' for role in entry.roles)
    return f'"{key}" = {{ name = "{entry.name}", roles = [{roles}] }}\n'
