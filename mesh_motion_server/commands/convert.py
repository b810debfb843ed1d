"""``mesh-motion convert``: a mesh as an archive, in partitions, for ParaView, or as its own file with moved nodes."""

# ruff: noqa: PLC0415

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer
from mesh_motion_protocol.errors import MeshMotionError

from mesh_motion_server.commands.outcome import complain, say, status_of


def convert(
    source: Annotated[Path, typer.Argument(metavar="IN", help="A mesh file or an OpenFOAM case.", show_default=False)],
    target: Annotated[
        Path,
        typer.Argument(
            metavar="OUT",
            help="File that ends in .npz, in .vtu or as IN does; with --partitions a folder.",
            show_default=False,
        ),
    ],
    points: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.npy", help="New coordinates in the order of IN's nodes, for example points.npy of play."
        ),
    ] = None,
    zone: Annotated[str, typer.Option(metavar="NAME", help="Zone to read from a file with several zones.")] = "",
    partitions: Annotated[
        int | None,
        typer.Option(metavar="N", min=1, help="Cut the mesh into N partitions: OUT/partition-000.npz and so on."),
    ] = None,
) -> None:
    """Write a mesh as .npz, as .vtu for ParaView, or in the format of its own file with other coordinates.

    \b
    mesh-motion convert mesh.msh wing.npz
    mesh-motion convert mesh.msh mesh.vtu
    mesh-motion convert mesh.su2 moved.su2 --points out/points.npy
    mesh-motion convert mesh.msh parts --partitions 4
    """
    from mesh_motion_server.files import read_mesh
    from mesh_motion_server.files.npz import read_points
    from mesh_motion_server.files.partitions import write_partitions
    from mesh_motion_server.files.replace import require_folder_place
    from mesh_motion_server.files.writer import check_target, write_mesh

    try:
        if partitions:
            require_folder_place(target)
        else:
            check_target(target, source)
        mesh = read_mesh(source, zone)
        if points is not None:
            mesh = replace(mesh, points=read_points(points, mesh.points.shape))
        if partitions:
            write_partitions(target, mesh, partitions)
        else:
            write_mesh(target, mesh)
    except MeshMotionError as error:
        complain(str(error))
        raise typer.Exit(status_of(error.code)) from None
    for note in mesh.notes:
        complain(f"warning: {note}")
    cells = ", ".join(f"{len(nodes)} {name}" for name, nodes in mesh.cells.items())
    files = f", {partitions} partitions" if partitions else ""
    say(f"{target}: {mesh.dimension}D, {len(mesh.points)} nodes, {cells}, {len(mesh.patches)} patches{files}")
