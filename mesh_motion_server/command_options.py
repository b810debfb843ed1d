"""Options that several commands take."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

__all__ = ["DistributedOption", "EndpointOption", "KeyOption", "ServerKeyOption"]

EndpointOption = Annotated[
    str | None,
    typer.Option(metavar="ENDPOINT", help="A running server: tcp://HOST:PORT or ipc:///PATH.", show_default=False),
]
DistributedOption = Annotated[
    str | None,
    typer.Option(
        metavar="SCHEDULER", help="Dask workers compute: tcp://HOST:PORT of their scheduler.", show_default=False
    ),
]
KeyOption = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="Your .secret file, for a server with keys; or MESH_MOTION_KEY names it."),
]
ServerKeyOption = Annotated[
    str | None,
    typer.Option(metavar="FILE", help="The server's .public file; or MESH_MOTION_SERVER_KEY names it."),
]
