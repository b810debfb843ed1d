"""Options that several commands take."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from mesh_motion_client import Keys

EndpointOption = Annotated[
    str | None,
    typer.Option(
        metavar="ENDPOINT", help="Address of a running server: tcp://HOST:PORT or ipc:///PATH.", show_default=False
    ),
]
KeyOption = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="Your .secret file, if the server uses keys; by default the one that MESH_MOTION_KEY names.",
    ),
]
ServerKeyOption = Annotated[
    str | None,
    typer.Option(
        metavar="FILE", help="The server's .public file; by default the one that MESH_MOTION_SERVER_KEY names."
    ),
]


def keys_of_options(endpoint: str | None, key: Path | None, server_key: str | None) -> Keys | None:
    """Return the keys from the options and the environment; a private server needs none."""
    # NumPy and the socket take a quarter of a second, and most commands need neither
    from mesh_motion_client import InvalidInput, Keys  # noqa: PLC0415
    from mesh_motion_client.keys import KEY_VARIABLE, SERVER_KEY_VARIABLE  # noqa: PLC0415

    key_name = str(key or os.environ.get(KEY_VARIABLE, ""))
    server_name = server_key or os.environ.get(SERVER_KEY_VARIABLE, "")
    if endpoint is None or not (key_name or server_name):
        return None
    if not key_name or not server_name:
        raise InvalidInput("--key and --server-key must be given both, or neither")
    return Keys.load(key_name, server_name)
