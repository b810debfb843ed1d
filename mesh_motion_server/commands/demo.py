"""``mesh-motion demo``: the thesis' cases and a flag."""

# ruff: noqa: PLC0415

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mesh_motion_server.commands.expected_errors import expected_errors
from mesh_motion_server.commands.outcome import complain, say, show


def demo(
    out: Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="Folder for pictures and results.")] = Path(
        "out/demo"
    ),
) -> None:
    """Play the thesis' three cases and a flag in a channel, each without and with correction.

    The command prints a table, and writes a picture and the results of each case into DIR. It takes about a minute.

    \b
    mesh-motion demo --out out/demo
    """
    from mesh_motion_server.cases.demo import play_demo, table_of
    from mesh_motion_server.files.replace import require_folder_place
    from mesh_motion_server.watch.pictures.page import pictures_are_possible
    from mesh_motion_server.watch.terminal.console import working

    if not pictures_are_possible():
        complain("warning: no pictures without matplotlib: pip install 'mesh-motion-server[plot]'")
    with expected_errors(), working("starting a server") as say_what:
        require_folder_place(out)
        outcomes = play_demo(out, say_what)
    show(table_of(outcomes))
    for picture in sorted(out.glob("*.png")):
        say(f"see {picture}")
