"""``mesh-motion plot``: pictures of runs for papers, from a session's folder or from the results of ``play``."""

# ruff: noqa: PLC0415

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from mesh_motion_protocol.errors import InvalidInput, MeshMotionError

from mesh_motion_server.commands.outcome import complain, status_of

if TYPE_CHECKING:
    from mesh_motion_server.watch.pictures.page import Page

_PICTURES = ("history", "mesh")


def plot(
    runs: Annotated[
        list[Path],
        typer.Argument(metavar="RUN…", help="Folders of stored sessions, or results of play.", show_default=False),
    ],
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="FILE", help="Picture to write; the name ends in .png, .svg or .pdf.")
    ],
    show: Annotated[
        str, typer.Option(metavar="WHAT", help="history: quality, iterations, seconds; mesh: before and after.")
    ] = "history",
    size: Annotated[
        str, typer.Option(metavar="SIZE", help="column, wide, page or slide; or WIDTH or WIDTHxHEIGHT in mm.")
    ] = "wide",
    metric: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Quality metric that the run recorded; with --show mesh any, non-orthogonality or face-skewness.",
            show_default=False,
        ),
    ] = None,
    steps: Annotated[
        str | None,
        typer.Option(metavar="A:B", help="Draw steps A to B; with --show mesh, step A before and step B after."),
    ] = None,
    panel: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="Draw this panel: quality, iterations, seconds, enrichment or non-orthogonality; repeatable.",
            show_default=False,
        ),
    ] = None,
    title: Annotated[
        str | None, typer.Option(metavar="TEXT", help='Title of the picture; "" for no title.', show_default=False)
    ] = None,
    dark: Annotated[bool, typer.Option("--dark", help="Draw light lines on a dark background.")] = False,
    dpi: Annotated[
        int,
        typer.Option(
            min=50, max=1200, metavar="N", help="Dots per inch of PNG files, and of large meshes in all files."
        ),
    ] = 300,
) -> None:
    """Draw the history of runs, or a mesh before and after, for a paper, a page or a slide.

    Several runs are drawn into the same axes. PDF files contain text and fonts, not outlines. The same run always
    gives the same file.

    \b
    mesh-motion plot out/flag --out flag.pdf --size column
    mesh-motion plot out/standard out/corrected -o compared.svg --panel quality --title ""
    mesh-motion plot ~/.local/state/mesh-motion/sessions/0123… -o mesh.png --show mesh --size page
    """
    if show not in _PICTURES:
        raise typer.BadParameter(f"one of {', '.join(_PICTURES)}", param_hint="--show")
    try:
        page = _page(out, size, dark=dark, dpi=dpi)
        first, last = _steps(steps)
        if show == "history":
            _history(runs, out, page, metric, (first, last), panel, title)
        else:
            _mesh(runs, out, page, metric, (first, last), title)
    except MeshMotionError as error:
        complain(str(error))
        raise typer.Exit(status_of(error.code)) from None


def _page(out: Path, size: str, *, dark: bool, dpi: int) -> Page:
    """Return the page to draw on."""
    from mesh_motion_server.files.replace import require_folder_place
    from mesh_motion_server.watch.pictures.page import Page, format_of, parse_size
    from mesh_motion_server.watch.pictures.palette import DARK, LIGHT

    format_of(out)
    require_folder_place(out.parent)
    width, height, points = parse_size(size)
    return Page(width, height, DARK if dark else LIGHT, points, dpi)


def _steps(text: str | None) -> tuple[int | None, int | None]:
    """Parse ``A:B``; either part may be missing."""
    if text is None:
        return None, None
    found = re.fullmatch(r"\s*([0-9]{0,18})\s*:\s*([0-9]{0,18})\s*", text)
    if found is None:
        raise InvalidInput(f"--steps: expected A:B, A: or :B, got {text!r}", hint="--steps 100:200")
    first, last = (int(part) if part else None for part in found.groups())
    if first is not None and last is not None and last < first:
        raise InvalidInput(f"--steps: {last} comes before {first}", hint=f"--steps {last}:{first}")
    return first, last


def _history(
    folders: list[Path],
    out: Path,
    page: Page,
    metric: str | None,
    steps: tuple[int | None, int | None],
    panels: list[str] | None,
    title: str | None,
) -> None:
    from mesh_motion_server.watch.pictures.history import PANELS, draw_history
    from mesh_motion_server.watch.pictures.page import save, styled
    from mesh_motion_server.watch.pictures.runs import read_runs

    unknown = [name for name in panels or () if name not in PANELS]
    if unknown:
        raise InvalidInput(f"--panel: expected one of {', '.join(PANELS)}, got {unknown[0]!r}")
    runs = [run.between(*steps) for run in read_runs(folders, metric)]
    with styled(page):
        save(draw_history(runs, page, title=title, panels=panels), out, page)


def _mesh(
    folders: list[Path],
    out: Path,
    page: Page,
    metric: str | None,
    steps: tuple[int | None, int | None],
    title: str | None,
) -> None:
    from mesh_motion_server.watch.pictures.before_after import draw_before_after
    from mesh_motion_server.watch.pictures.meshes import read_pair
    from mesh_motion_server.watch.pictures.page import save, styled

    if len(folders) > 1:
        raise InvalidInput(f"--show mesh draws one run, got {len(folders)}", hint="name one of them")
    pair = read_pair(folders[0], metric, *steps)
    with styled(page):
        save(draw_before_after(pair, page, title=title), out, page)
