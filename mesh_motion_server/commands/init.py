"""``mesh-motion init``: writes a first case file."""

# ruff: noqa: PLC0415

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mesh_motion_server.commands.expected_errors import expected_errors
from mesh_motion_server.commands.outcome import complain, say


def init(
    mesh: Annotated[Path, typer.Argument(metavar="MESH", help="A mesh file or an OpenFOAM case.", show_default=False)],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", metavar="CASE.toml", help="File to write; by default case.toml in the mesh's folder."
        ),
    ] = None,
    zone: Annotated[str, typer.Option(metavar="NAME", help="Zone to read from a mesh file with several zones.")] = "",
) -> None:
    """Write a commented case file: the mesh's patches, a guess of their roles, and a motion that the mesh can follow.

    \b
    mesh-motion init examples/thesis_rotation/mesh.npz --out first.toml
    """
    from mesh_motion_protocol.errors import InvalidInput

    from mesh_motion_server.cases.draft import tried_draft
    from mesh_motion_server.files import read_mesh
    from mesh_motion_server.files.replace import replacing, require_file_place

    target = out or mesh.parent / "case.toml"
    with expected_errors():
        require_file_place(target)
        if target.exists():
            raise InvalidInput(f"{target} exists", hint="give another file with --out")
        found = read_mesh(mesh, zone)
        text, refused = tried_draft(found, target, zone)
        with replacing(target) as file:
            file.write(text.encode())
    for warning in found.notes:
        complain(f"warning: {warning}")
    if refused:
        complain(f"warning: the drafted motion will be refused: {refused}")
    say(f"{target}: check the roles in it, then: mesh-motion play {target}")
