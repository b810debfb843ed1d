"""``mesh-motion play``: plays a case, or a stored session again, through an ordinary session."""

# ruff: noqa: PLC0415

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mesh_motion_server.commands.expected_errors import expected_errors
from mesh_motion_server.commands.options import EndpointOption, KeyOption, ServerKeyOption, keys_of_options
from mesh_motion_server.commands.outcome import complain, say
from mesh_motion_server.commands.replay import changes_of, print_comparison

if TYPE_CHECKING:
    from mesh_motion_server.cases.records import StepRecord

CaseArgument = Annotated[Path | None, typer.Argument(metavar="CASE.toml", help="The case file.", show_default=False)]
OutOption = Annotated[
    Path | None,
    typer.Option(
        "--out", "-o", metavar="DIR", help="Folder for the results; by default out/NAME in the case's folder."
    ),
]


def play(
    case: CaseArgument = None,
    out: OutOption = None,
    from_journal: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Replay the stored session in FOLDER instead of a case.")
    ] = None,
    assignments: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Replay with this setting; repeatable.")
    ] = None,
    until: Annotated[int | None, typer.Option(min=1, metavar="N", help="Replay the steps up to N.")] = None,
    endpoint: EndpointOption = None,
    key: KeyOption = None,
    server_key: ServerKeyOption = None,
    every: Annotated[
        int, typer.Option(min=1, metavar="N", help="Write every N-th step to the series of VTU files.")
    ] = 1,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print warnings and errors only.")] = False,
) -> None:
    """Move a mesh as a case file describes, with the same requests as those of a coupled solver.

    Without --endpoint a private server is started and stopped again. DIR receives summary.json, points.npy, steps.csv,
    mesh.pvd with its VTU files for ParaView, and quality.png. A run that is refused or
    interrupted keeps its accepted steps: accepted.npy replaces points.npy, and a refused mesh is in refused.vtu and
    quality.png.

    \b
    mesh-motion play examples/thesis_rotation/case.toml --out out/rotation
    mesh-motion play case.toml -o out --endpoint tcp://127.0.0.1:7440

    With --from-journal the recorded boundary motion of a stored session, or of a copy of its folder, is replayed, with
    the settings of the session or with others (--set). A table compares the results, and DIR receives comparison.json
    too. The status is 1 if no setting was changed but the states differ.

    \b
    mesh-motion play --from-journal ~/.local/state/mesh-motion/sessions/0123… -o out/again
    mesh-motion play --from-journal ~/.local/state/mesh-motion/sessions/0123… -o out/tuned --set support_radius=0.8
    """
    from mesh_motion_server.cases.case import case_name
    from mesh_motion_server.cases.faces import faces_line
    from mesh_motion_server.cases.play import play as play_case
    from mesh_motion_server.cases.records import drawn
    from mesh_motion_server.cases.replay import replay

    if (case is None) == (from_journal is None):
        raise typer.BadParameter("give either CASE.toml or --from-journal", param_hint="CASE.toml")
    if from_journal is None and (assignments or until):
        raise typer.BadParameter("--set and --until need --from-journal; a case has its own settings")
    if out is None:
        if case is None:
            raise typer.BadParameter("a replay needs a folder for its results", param_hint="--out")
        out = case.parent / "out" / case_name(case)
    if case is None:
        with expected_errors(), _progress(quiet) as advance:
            comparison = replay(
                Path(str(from_journal)),
                out,
                changes_of(assignments or ()),
                until=until,
                endpoint=endpoint,
                keys=keys_of_options(endpoint, key, server_key),
                every=every,
                progress=advance,
            )
        print_comparison(comparison, quiet=quiet)
        return
    with expected_errors(), _progress(quiet) as advance:
        keys = keys_of_options(endpoint, key, server_key)
        played = play_case(case, out, endpoint=endpoint, every=every, progress=advance, keys=keys)
    for warning in played.warnings:
        complain(f"warning: {warning}")
    if not quiet:
        summary = played.summary
        judged = drawn(summary["method"]["quality_metric"])
        say(
            f"{len(played.steps)} step{'s' if len(played.steps) > 1 else ''} in {summary['seconds']:.1f} s, "
            f"lowest {judged} {summary['min_' + judged.replace('-', '_')]:.3f} in step {summary['worst_step']}, "
            f"{summary['inverted_cells']} inverted cells: {out}"
        )
        if line := faces_line([step.faces for step in played.steps]):
            say(line)
        if played.steps and (line := played.steps[-1].ahead):
            say(line)


@contextmanager
def _progress(quiet: bool) -> Iterator[Any]:
    """A progress bar on standard error that vanishes at the end; a function to advance it."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from mesh_motion_server.watch.terminal.console import progress_bar

    with progress_bar("opening the session") as advance:

        def record_step(done: int, total: int, record: StepRecord) -> None:
            advance(done, total, f"size-skew {record.min_size_skew:.3f}")

        yield record_step
