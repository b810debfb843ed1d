"""``mesh-motion keys``: makes keys, and changes the list of users of a server."""

# ruff: noqa: PLC0415

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mesh_motion_server.commands.completions import roles
from mesh_motion_server.commands.expected_errors import expected_errors
from mesh_motion_server.commands.outcome import say

keys = typer.Typer(
    help="Make keys, and choose which clients may use a server: docs/security.md.",
    no_args_is_help=True,
    rich_markup_mode=None,
)

Folder = Annotated[Path, typer.Argument(metavar="DIR", help="The server's key folder.", show_default=False)]


@keys.command(short_help="Make a server's keys.")
def server(folder: Folder) -> None:
    """Make DIR/server.secret, DIR/server.public, and an empty list of admitted keys, DIR/allow.toml.

    \b
    mesh-motion keys server keys
    mesh-motion serve --endpoint tcp://0.0.0.0:7440 --keys keys
    """
    from mesh_motion_server.security.key_folder import make_server_keys

    with expected_errors():
        make_server_keys(folder)
    say(f"{folder}/server.secret stays here; clients need {folder}/server.public")


@keys.command(short_help="Make a client's keys.")
def client(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the client.", show_default=False)],
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder for the key files.", show_default=False)],
) -> None:
    """Make DIR/NAME.secret, which the client keeps, and DIR/NAME.public, which the server's operator needs.

    \b
    mesh-motion keys client alice ~/.config/mesh-motion
    """
    from mesh_motion_server.security.key_folder import make_client_keys

    with expected_errors():
        make_client_keys(name, folder)
    say(f"{folder}/{name}.secret stays here; the server's operator needs {folder}/{name}.public")


@keys.command(short_help="Admit a client's key.")
def allow(
    public: Annotated[
        str, typer.Argument(metavar="PUBLIC", help="A .public file, or the key itself.", show_default=False)
    ],
    folder: Folder,
    role: Annotated[
        list[str] | None,
        typer.Option(
            metavar="ROLE",
            help="Role of the client: owner (default), monitor or admin; repeatable.",
            autocompletion=roles,
        ),
    ] = None,
    name: Annotated[
        str, typer.Option(metavar="NAME", help="Name of the client; by default the name in the file.")
    ] = "",
) -> None:
    """Add a key to the list of admitted keys; a running server reads the list at the next connection.

    An owner opens sessions and has all rights to these, but no right to other owners' sessions. A monitor reads the
    state of every session, but no mesh. An admin may close sessions too.

    \b
    mesh-motion keys allow alice.public keys
    mesh-motion keys allow dashboard.public keys --role monitor
    """
    from mesh_motion_server.security.key_folder import admit

    with expected_errors():
        entry = admit(public, folder, name=name, roles=role or ())
    say(f"{entry.name} is admitted as {', '.join(entry.roles)}")


@keys.command(short_help="Remove a client's key.")
def revoke(
    name: Annotated[
        str, typer.Argument(metavar="NAME", help="Name of the client, or the key itself.", show_default=False)
    ],
    folder: Folder,
) -> None:
    """Remove a key from the list of admitted keys; its open connections are refused from their next request on.

    \b
    mesh-motion keys revoke alice keys
    """
    from mesh_motion_server.security.key_folder import revoke as take_off

    with expected_errors():
        entry = take_off(name, folder)
    say(f"{entry.name} is not admitted any more; the sessions are kept")


@keys.command("list", short_help="Show the admitted clients.")
def show(folder: Folder) -> None:
    """Show the names, roles and keys of the list of admitted keys.

    \b
    mesh-motion keys list keys
    """
    from mesh_motion_server.security.key_folder import ALLOW_LIST, read_list

    with expected_errors():
        entries = read_list(folder)
    for key, entry in sorted(entries.items(), key=lambda item: item[1].name):
        say(f"{entry.name:24} {','.join(entry.roles):20} {key}")
    if not entries:
        say(f"{folder / ALLOW_LIST} admits no client")
