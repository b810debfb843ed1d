"""``mesh-motion convert``: a mesh in another format, or with the coordinates that a run left."""

# ruff: noqa: PLC0415

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mesh_motion_server.cli import complain, status_of
from mesh_motion_server.errors import MeshMotionError

__all__ = ["convert"]


def convert(
    source: Annotated[Path, typer.Argument(metavar="IN", help="A mesh file or an OpenFOAM case.", show_default=False)],
    target: Annotated[Path, typer.Argument(metavar="OUT", help="Its suffix says how.", show_default=False)],
    points: Annotated[
        Path | None, typer.Option(metavar="FILE.npy", help="Coordinates in the order of IN's nodes: play's points.npy.")
    ] = None,
    zone: Annotated[str, typer.Option(metavar="NAME", help="The zone of IN, where it has several.")] = "",
) -> None:
    """Write a mesh in another format: .msh, .su2, .vtu, .vtk, .cgns, .npz, or a folder, which is an OpenFOAM case.

    With --points and the format of IN, coordinates alone are replaced: everything else of the file stays as it is. The
    new points of an OpenFOAM case may go to one of its times (CASE/0.5).

    \b
    mesh-motion convert mesh.msh mesh.cgns
    mesh-motion convert mesh.npz moved.su2 --points out/points.npy
    """
    from mesh_motion_server.files import read_mesh
    from mesh_motion_server.files.npz import read_points
    from mesh_motion_server.files.writer import check_target, write_mesh, write_moved

    try:
        check_target(target)
        mesh = read_mesh(source, zone)
        if points is None:
            write_mesh(target, mesh)
        else:
            write_moved(target, mesh, read_points(points))
    except MeshMotionError as error:
        complain(str(error))
        raise typer.Exit(status_of(error.code)) from None
    for note in mesh.notes:
        complain(f"warning: {note}")
    cells = ", ".join(f"{len(nodes)} {name}" for name, nodes in mesh.cells.items())
    typer.echo(f"{target}: {mesh.dimension}D, {len(mesh.points)} nodes, {cells}, {len(mesh.patches)} patches")
