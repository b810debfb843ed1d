"""``mesh-motion check``: the faults of a case or a mesh, and the motions that will be refused."""

# ruff: noqa: PLC0415

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mesh_motion_server.commands.expected_errors import expected_errors
from mesh_motion_server.commands.outcome import ExitStatus, complain, say, say_json, show

if TYPE_CHECKING:
    from mesh_motion_server.cases.check import CheckReport


def check(
    path: Annotated[Path, typer.Argument(metavar="CASE.toml|MESH", help="A case or a mesh file.", show_default=False)],
    zone: Annotated[str, typer.Option(metavar="NAME", help="Zone to read from a mesh file with several zones.")] = "",
    seconds: Annotated[
        float, typer.Option(min=0.0, metavar="S", help="Longest time for the prediction of a case's motion.")
    ] = 20.0,
    as_json: Annotated[bool, typer.Option("--json", help="Print the report as JSON.")] = False,
) -> None:
    """Report faults of a mesh or a case, and the step of the case that the server will refuse.

    The report has the roles of the patches, degenerate and inverted cells, duplicated and orphan nodes, and a suggested
    support radius. If a step of a case will be refused, the report has the step, the reason and the place, and the
    status is 3.

    \b
    mesh-motion check case.toml
    mesh-motion check mesh.msh
    """
    from mesh_motion_server.cases.check import check as check_path

    with expected_errors():
        report = check_path(path, zone, seconds=seconds)
    if as_json:
        say_json(_check_values(report))
    else:
        _print_check(report)
    for warning in report.warnings:
        complain(f"warning: {warning}")
    if report.refused:
        complain(report.refused)
        raise typer.Exit(ExitStatus.REFUSED)


def _check_values(report: CheckReport) -> dict[str, Any]:
    """The report as plain values."""
    mesh = report.mesh
    return {
        "path": str(report.path),
        "nodes": len(mesh.points),
        "dimension": mesh.dimension,
        "cells": {name: len(nodes) for name, nodes in mesh.cells.items()},
        "patches": {n: {"role": report.roles.get(n, ""), "nodes": len(ids)} for n, ids in mesh.patches.items()},
        "counts": report.counts,
        "pairs": report.pairs,
        "quality": report.quality,
        "support_radius": report.support_radius,
        "suggested_support_radius": report.suggested.support_radius,
        "suggested_basis": report.suggested.basis,
        "steps_accepted": report.steps,
        "refused": report.refused,
        "warnings": report.warnings,
    }


def _print_check(report: CheckReport) -> None:
    """The report as a table."""
    from mesh_motion_numerics.interpolation.kernels import DEFAULT_BASIS

    from mesh_motion_server.watch.terminal.console import Table

    mesh = report.mesh
    cells = ", ".join(f"{len(nodes)} {name}" for name, nodes in mesh.cells.items())
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    box = " × ".join(f"[{a:g}, {b:g}]" for a, b in zip(low, high, strict=True))
    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_row("mesh", f"{mesh.path}: {mesh.dimension}D, {len(mesh.points)} nodes, {cells}")
    table.add_row("box", box)
    for name, nodes in mesh.patches.items():
        table.add_row("patch", f"{name}: {len(nodes)} nodes, {report.roles.get(name, 'no role here')}")
    if report.counts:
        table.add_row("nodes", ", ".join(f"{count} {kind}" for kind, count in report.counts.items()))
    for pair in report.pairs:
        table.add_row("periodic", pair)
    table.add_row("quality", ", ".join(f"{name} {value:.3f}" for name, value in report.quality.items()))
    chosen = f"{report.support_radius:g} in the case, " if report.support_radius is not None else ""
    with_basis = "" if report.suggested.basis == DEFAULT_BASIS else f" with the basis {report.suggested.basis}"
    table.add_row("support radius", f"{chosen}{report.suggested.support_radius:g} suggested{with_basis}")
    if report.steps:
        table.add_row("motion", f"{report.steps} steps are accepted")
    show(table)
    if not report.refused:
        say(f"usable{' as a case' if report.roles else ' as a mesh'}")
