"""The demonstration's pictures: standard beside corrected, in one colour scale."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from matplotlib.figure import Figure

from mesh_motion_server.watch.pictures.mesh_axes import draw_mesh
from mesh_motion_server.watch.pictures.palette import INK, INVERTED_COLOUR, LIGHT
from mesh_motion_server.watch.pictures.snapshot import choose_window

if TYPE_CHECKING:
    from mesh_motion_server.cases.demo import Outcome

__all__ = ["draw_flag", "draw_overview"]

_STANDARD, _CORRECTED = LIGHT.faint, LIGHT.runs[0]


def draw_overview(path: Path, outcomes: Sequence[Outcome]) -> None:
    """Two rows, standard and corrected; one column per case. The file's description has the corrected numbers too."""
    figure = Figure(figsize=(5.0 * len(outcomes), 10.6), dpi=100, layout="constrained")
    axes = figure.subplots(2, len(outcomes), squeeze=False)
    for column, outcome in enumerate(outcomes):
        for row, (label, played) in enumerate((("standard RBF", outcome.standard), ("corrected", outcome.corrected))):
            before, after = played.before, played.worst
            summary = played.summary
            title = f"{label}: lowest size-skew {summary['min_size_skew']:.3f}, {summary['inverted_cells']} inverted"
            title = f"{outcome.case.title}\n{title}" if row == 0 else title
            colours = draw_mesh(axes[row, column], after, None, title, choose_window(before, after, None))
            axes[row, column].tick_params(labelbottom=False, labelleft=False, length=0)
    _colour_bar(figure, colours, axes.ravel().tolist())
    lowest = " ".join(f"{outcome.corrected.summary['min_size_skew']:.3f}" for outcome in outcomes)
    figure.savefig(path, metadata={"Software": None, "Description": lowest})


def draw_flag(path: Path, outcome: Outcome) -> None:
    """Both meshes at their worst step, and the history of the minimum."""
    figure = Figure(figsize=(14.0, 8.6), dpi=100, layout="constrained")
    figure.suptitle(outcome.case.title, fontsize=14, fontweight="bold", color=INK)
    axes = figure.subplot_mosaic([["standard", "corrected"], ["history", "history"]], height_ratios=[1.6, 1.0])
    for label, played in (("standard", outcome.standard), ("corrected", outcome.corrected)):
        before, after = played.before, played.worst
        title = f"{label}, its worst step: {after.step}"
        colours = draw_mesh(axes[label], after, None, title, choose_window(before, after, None))
    _colour_bar(figure, colours, [axes["standard"], axes["corrected"]])
    for label, played, colour in (
        ("standard", outcome.standard, _STANDARD),
        ("corrected", outcome.corrected, _CORRECTED),
    ):
        lowest = [float(played.before.quality.min()), *(step.min_size_skew for step in played.steps)]
        axes["history"].plot(range(len(lowest)), lowest, color=colour, marker="o", markersize=3, label=label)
    axes["history"].axhline(0.0, color=INVERTED_COLOUR, linewidth=0.8)
    axes["history"].set(xlabel="step", title="lowest size-skew", xlim=(0, len(lowest) - 1), ylim=(None, 1.0))
    axes["history"].legend(frameon=False)
    axes["history"].grid(alpha=0.25)
    figure.savefig(path, metadata={"Software": None})


def _colour_bar(figure: Figure, colours: Any, axes: list[Any]) -> None:
    bar = figure.colorbar(colours, ax=axes, shrink=0.7, pad=0.01, extend="min")
    bar.set_label("size-skew of a cell (inverted: pink)")
