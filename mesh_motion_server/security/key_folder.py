"""Makes and admits keys: the work of ``mesh-motion keys``.

::

    SERVER FOLDER/                 0700
        server.secret              0600: stays on the server's machine
        server.public              for the clients
        allow.toml                 the admitted client keys with their roles
    CLIENT FOLDER/                 0700
        NAME.secret                0600: stays on the client's machine
        NAME.public                for the server's operator
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import zmq
from mesh_motion_protocol.errors import InvalidInput
from mesh_motion_protocol.key_files import KeyFileError, PublicKey, SecretKey, checked_key, checked_name

from mesh_motion_server.absence import is_missing
from mesh_motion_server.security.allow_list import Entry, read_entries, write_entries
from mesh_motion_server.security.authorisation import ROLES, Role

#: Name of the server's own keys.
SERVER = "server"
ALLOW_LIST = "allow.toml"


def require_curve() -> None:
    """Raise InvalidInput unless this libzmq has CURVE."""
    if not zmq.has("curve"):
        raise InvalidInput(
            f"keys need CURVE, but libzmq {zmq.zmq_version()} was built without it",
            hint="install pyzmq from its wheel, or a libzmq with libsodium",
        )


def make_server_keys(folder: Path) -> PublicKey:
    """A server's key pair and an allow-list that admits no key.

    Raises InvalidInput if there are keys already, or the folder cannot be written.
    """
    public = _make_pair(SERVER, folder)
    try:
        if is_missing(folder / ALLOW_LIST):
            _write(folder, {})
    except OSError as error:
        raise InvalidInput(f"{folder / ALLOW_LIST}: cannot be read: {error.strerror}") from None
    return public


def make_client_keys(name: str, folder: Path) -> PublicKey:
    """Make a client's key pair.

    Raises InvalidInput if there are keys of that name already, the name is invalid, or the folder cannot be written.
    """
    try:
        checked_name(name)
    except KeyFileError as error:
        raise InvalidInput(str(error)) from None
    if name == SERVER:
        raise InvalidInput(f"{SERVER!r} is the name of a server's own keys", hint="take another name")
    return _make_pair(name, folder)


def admit(public: str, folder: Path, *, name: str = "", roles: Sequence[str] = ()) -> Entry:
    """Put a key on a server's allow-list; an existing key gets the new name and roles.

    Raises InvalidInput if a key, a role or the list is not valid, or the name is that of another key.

    Parameters
    ----------
    public : str
        A file with a public key, or the key itself.
    folder : Path
        The server's folder of keys.
    name : str, optional
        Default: the name in the file.
    roles : sequence of str, optional
        Default: owner.
    """
    key = _public_key(public, name)
    unknown = [role for role in roles if role not in ROLES]
    if unknown:
        raise InvalidInput(f"a role must be one of {', '.join(Role)}, got {unknown[0]!r}")
    entries = read_list(folder)
    others = {entry.name for other, entry in entries.items() if other != key.key}
    if key.name in others:
        raise InvalidInput(f"{key.name!r} is the name of another key", hint="revoke that key first, or give --name")
    entry = Entry(key.name, tuple(dict.fromkeys(roles)) or (Role.OWNER.value,))
    _write(folder, entries | {key.key: entry})
    return entry


def revoke(name: str, folder: Path) -> Entry:
    """Take a key off a server's allow-list, by its name or the key itself.

    Raises InvalidInput if the list does not name it.
    """
    entries = read_list(folder)
    found = [key for key, entry in entries.items() if name in (entry.name, key)]
    if not found:
        known = ", ".join(sorted(entry.name for entry in entries.values())) or "no key"
        raise InvalidInput(f"{folder / ALLOW_LIST} does not name {name!r}; it names {known}")
    entry = entries.pop(found[0])
    _write(folder, entries)
    return entry


def _make_pair(name: str, folder: Path) -> PublicKey:
    require_curve()
    public, secret = (key.decode("ascii") for key in zmq.curve_keypair())
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        SecretKey(name, secret).save(folder / f"{name}.secret")
        PublicKey(name, public).save(folder / f"{name}.public")
    except OSError as error:
        raise InvalidInput(f"{folder}: cannot be made: {error.strerror}") from None
    except KeyFileError as error:
        raise InvalidInput(str(error), hint="keys are never overwritten: use another folder or name") from None
    return PublicKey(name, public)


def _public_key(public: str, name: str) -> PublicKey:
    try:
        if name and not Path(public).exists():  # a key or a file
            return PublicKey(checked_name(name), checked_key(public))
        loaded = PublicKey.load(public)
        return PublicKey(checked_name(name), loaded.key) if name else loaded
    except KeyFileError as error:
        raise InvalidInput(str(error), hint="give a .public file, or a key and --name") from None


def read_list(folder: Path) -> dict[str, Entry]:
    """Return the admitted keys of a server. Raises InvalidInput."""
    try:
        return read_entries(folder / ALLOW_LIST)
    except OSError as error:
        raise InvalidInput(
            f"{folder / ALLOW_LIST}: cannot be read: {error.strerror}",
            hint=f"`mesh-motion keys server {folder}` makes it",
        ) from None


def _write(folder: Path, entries: dict[str, Entry]) -> None:
    try:
        write_entries(folder / ALLOW_LIST, entries)
    except OSError as error:
        raise InvalidInput(f"{folder / ALLOW_LIST}: cannot be written: {error.strerror}") from None
