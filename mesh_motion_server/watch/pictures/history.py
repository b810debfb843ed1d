"""The history of one run, or of several in the same axes: quality, iterations, seconds, enrichment points, faces.

For one run, the quality panel has the minimum and the mean after each step, the percentiles as bands, the prediction
before any node moved as a wide pale line below (visible where the prediction differs), the motion without its
correction, the threshold, and a mark where a motion was refused. For several runs it has minimum and mean, with one
colour and dash per run.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from mesh_motion_numerics.arrays import Floats
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.watch.observation.series import PHASES
from mesh_motion_server.watch.pictures.page import Page, blank
from mesh_motion_server.watch.pictures.runs import Run

#: More steps than this are thinned: beyond it, two steps share one pixel of a page.
_MOST = 5000
#: Up to this number, each step has its own mark.
_FEW = 40
#: A run of a single step is drawn as a dash of this many steps to either side.
_HALF_DASH = 0.25
#: A first step is cut off if it took this many times as long as any later step: it makes the factorizations.
_TALL = 3.0
#: Heights, mm: of the quality panel as a share of the width within limits, of any other panel as a share of the quality
#: panel.
_HEIGHT, _LOWEST, _HIGHEST, _SMALL = 0.42, 38.0, 80.0, 0.5


def panels_of(runs: Sequence[Run]) -> list[str]:
    """The panels that have data to show, in order."""
    return [name for name, (_, has) in PANELS.items() if any(has(run) for run in runs)]


def draw_history(
    runs: Sequence[Run], page: Page, *, title: str | None = None, panels: Sequence[str] | None = None
) -> Any:
    """A matplotlib figure of the runs' history; make and save it within :func:`~.page.styled`.

    Raises InvalidInput if the runs have no step.

    Parameters
    ----------
    runs : sequence of Run
        All of the same metric.
    title : str, optional
        None: the label of a single run; "": none.
    panels : sequence of str, optional
        Panels of :data:`PANELS`, from top to bottom; None: all that have data to show.
    """
    if not any(len(run.step) for run in runs):
        raise InvalidInput(
            f"no step was committed yet: {', '.join(run.label for run in runs)}", hint="wait for the first one"
        )
    names = list(panels) if panels else panels_of(runs)
    tall = min(max(_HEIGHT * page.width, _LOWEST), _HIGHEST)
    heights = [1.0 if name == "quality" else _SMALL for name in names]
    figure = blank(page, tall * sum(heights) + 12.0)
    axes = figure.subplots(len(names), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
    shown = [run.thinned(_MOST) for run in runs]
    for name, panel in zip(names, axes, strict=True):
        PANELS[name][0](panel, shown, page)
        panel.grid(visible=True, axis="y")
        panel.set_axisbelow(True)
    axes[-1].set_xlabel("step")
    axes[-1].xaxis.get_major_locator().set_params(integer=True, min_n_ticks=1)
    low = min(int(run.step[0]) for run in shown if len(run.step))
    tried = [step for run in shown for step in run.refused]  # a refused step may not be committed yet
    high = max([*(int(run.step[-1]) for run in shown if len(run.step)), *tried])
    axes[-1].set_xlim((low - 0.5, high + 0.5) if low == high else (low, high))
    figure.align_ylabels(list(axes))
    title = runs[0].label if title is None and len(runs) == 1 else title
    if title:
        figure.suptitle(title)
    return figure


# --- quality ---------------------------------------------------------------------------------------------------------


def draw_quality(axes: Any, runs: Sequence[Run], page: Page) -> None:
    """Draw the quality of one run or of several into matplotlib axes."""
    if len(runs) == 1:
        _draw_one(axes, runs[0], page)
    else:
        _draw_several(axes, runs, page)
    _draw_refused(axes, runs, page)
    if any(np.any(run.columns["actual_min"] <= 0) for run in runs):  # marks an inverted cell
        axes.axhline(0.0, color=page.theme.refused, linewidth=0.6)
    axes.set_ylabel(runs[0].metric)
    low, high = axes.get_ylim()
    axes.set_ylim(low, min(1.0, high) if high - low > 0.05 else high)
    columns = 3 if page.width >= 120 else 2
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=columns, borderaxespad=0.2, columnspacing=1.5)


def _draw_one(axes: Any, run: Run, page: Page) -> None:
    """Draw all known data of one run."""
    theme, x = page.theme, run.step
    colour, mean = theme.runs[0], theme.runs[2]
    bands = (("p1", "p5", 0.26, "percentiles 1 to 5"), ("p5", "p50", 0.12, "5 to 50"))
    for low, high, opacity, label in bands:
        lower, upper = run.columns[f"actual_{low}"], run.columns[f"actual_{high}"]
        if np.isfinite(lower).any():
            axes.fill_between(*_dashed(x, lower, upper), color=colour, alpha=opacity, linewidth=0, label=label)
    _line(axes, x, run.columns["predicted_mean"], color=mean, linewidth=3.2, alpha=0.3)
    _line(axes, x, run.columns["predicted_min"], color=colour, linewidth=3.6, alpha=0.35, label="minimum, predicted")
    if np.any(run.columns["standard_min"] < run.columns["predicted_min"] - 1e-9):
        _line(axes, x, run.columns["standard_min"], color=theme.faint, linestyle=":", label="without correction")
    _line(axes, x, run.columns["actual_mean"], color=mean, linestyle=theme.dashes[1], label="mean")
    _line(axes, x, run.columns["actual_min"], color=colour, label="minimum", **_marks(x))
    if run.threshold is not None:
        axes.axhline(run.threshold, color=theme.ink, linewidth=0.7, linestyle=(0, (1, 2)), label="threshold")


def _draw_several(axes: Any, runs: Sequence[Run], page: Page) -> None:
    """Draw minimum and mean of each run."""
    theme = page.theme
    for number, run in enumerate(runs):
        style = {"color": theme.runs[number % len(theme.runs)], "linestyle": theme.dashes[number % len(theme.dashes)]}
        _line(axes, run.step, run.columns["actual_mean"], **style, linewidth=0.7, alpha=0.75)
        _line(axes, run.step, run.columns["actual_min"], **style, label=_shown(run.label), **_marks(run.step))
    axes.plot([], [], color=theme.ink, linewidth=0.7, alpha=0.75, label="mean (thin)")
    thresholds = {run.threshold for run in runs}
    if len(thresholds) == 1 and None not in thresholds:
        axes.axhline(thresholds.pop(), color=theme.ink, linewidth=0.7, linestyle=(0, (1, 2)), label="threshold")


def _shown(label: str) -> str:
    """Make a name visible in a legend.

    Matplotlib leaves out names that begin with an underscore, so a space is added in front.
    """
    return f" {label}" if label.startswith("_") else label


def _draw_refused(axes: Any, runs: Sequence[Run], page: Page) -> None:
    """A mark on the lower edge where a motion was refused."""
    steps = sorted({step for run in runs for step in run.refused})
    if steps:
        axes.plot(
            steps, np.zeros(len(steps)), linestyle="", marker="v", markersize=5, color=page.theme.refused,
            markeredgecolor=page.theme.paper, markeredgewidth=0.4, transform=axes.get_xaxis_transform(),
            clip_on=False, zorder=5, label="refused",
        )  # fmt: skip


def _line(axes: Any, x: Floats, y: Floats, **style: Any) -> None:
    """Draw a line of the known values; without known values no line and no legend entry."""
    if np.isfinite(y).any():
        axes.plot(*_dashed(x, y), **style)


def _dashed(x: Floats, *values: Floats) -> tuple[Floats, ...]:
    """Return a single step as three points, because a line through one is invisible; more steps unchanged."""
    if len(x) != 1:
        return x, *values
    return x + _HALF_DASH * np.array([-1.0, 0.0, 1.0]), *(np.repeat(each, 3) for each in values)


def _marks(x: Floats) -> dict[str, Any]:
    """The marker style: each step has a mark if there are few steps."""
    if len(x) > _FEW:
        return {}
    return {"marker": "o", "markersize": 2.5} | ({"markevery": [1]} if len(x) == 1 else {})


# --- the others ------------------------------------------------------------------------------------------------------


def _draw_counts(axes: Any, runs: Sequence[Run], page: Page, column: str, name: str) -> None:
    """Draw integers as a staircase for each run."""
    for number, run in enumerate(runs):
        colour = page.theme.runs[number % len(page.theme.runs)]
        style = page.theme.dashes[number % len(page.theme.dashes)]
        steps, values = _dashed(run.step, run.columns[column])
        axes.step(steps, values, where="mid", color=colour, linestyle=style, linewidth=0.9)
        if len(runs) == 1:
            axes.fill_between(steps, values, step="mid", color=colour, alpha=0.18, linewidth=0)
    axes.set_ylabel(name)
    axes.set_ylim(bottom=0)
    axes.yaxis.get_major_locator().set_params(integer=True)


def _draw_iterations(axes: Any, runs: Sequence[Run], page: Page) -> None:
    _draw_counts(axes, runs, page, "iterations", "iterations")


def _draw_enrichment(axes: Any, runs: Sequence[Run], page: Page) -> None:
    _draw_counts(axes, runs, page, "enrichment_points", "enrichment\npoints")


def _draw_orthogonality(axes: Any, runs: Sequence[Run], page: Page) -> None:
    """The largest non-orthogonality of each run."""
    for number, run in enumerate(runs):
        colour = page.theme.runs[number % len(page.theme.runs)]
        style = page.theme.dashes[number % len(page.theme.dashes)]
        _line(axes, run.step, run.columns["non_orthogonality"], color=colour, linestyle=style, linewidth=0.9)
    axes.set_ylabel("non-\northogonality, °")


def _draw_seconds(axes: Any, runs: Sequence[Run], page: Page) -> None:
    """Draw the phases' seconds: stacked for one run, their sums for several runs."""
    totals = [np.nansum([run.columns[f"seconds_{phase}"] for phase in PHASES], axis=0) for run in runs]
    largest = _shown_top(totals)
    unit, factor = ("s", 1.0) if largest >= 1.0 else ("ms", 1e3)
    if len(runs) == 1:
        colours = [page.theme.runs[i] for i in (0, 5, 1, 2)]
        parts = [np.nan_to_num(runs[0].columns[f"seconds_{phase}"]) * factor for phase in PHASES]
        steps, *parts = _dashed(runs[0].step, *parts)
        axes.stackplot(steps, parts, labels=PHASES, colors=colours, alpha=0.85, linewidth=0)
        axes.legend(
            loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4, borderaxespad=0.1, columnspacing=1.2,
            handlelength=0.9, handletextpad=0.4,
        )  # fmt: skip
    else:
        for number, (run, total) in enumerate(zip(runs, totals, strict=True)):
            style = page.theme.dashes[number % len(page.theme.dashes)]
            colour = page.theme.runs[number % len(page.theme.runs)]
            _line(axes, run.step, total * factor, color=colour, linestyle=style, linewidth=0.9)
    axes.set_ylabel(f"server, {unit}")
    axes.set_ylim(0, 1.08 * factor * largest if largest > 0 else 1.0)
    cut = [float(total[0]) for total in totals if len(total) and total[0] > 1.08 * largest]
    if cut:
        axes.annotate(
            f"first step: {max(cut) * factor:.3g} {unit}", (0.012, 0.95), xycoords="axes fraction", va="top",
            fontsize=page.points - 1.0, bbox={"facecolor": page.theme.paper, "edgecolor": "none", "pad": 1.0},
        )  # fmt: skip


def _shown_top(totals: Sequence[Floats]) -> float:
    """Upper end of the axis: the largest value, or the largest without the first steps if those are much larger."""
    first = max((float(total[0]) for total in totals if len(total)), default=0.0)
    later = max((float(total[1:].max()) for total in totals if len(total) > 1), default=0.0)
    return later if 0 < later * _TALL < first else max(first, later)


_Drawing = Callable[[Any, Sequence[Run], Page], None]
#: Name of each panel → its drawing function, and whether a run has data for it.
PANELS: dict[str, tuple[_Drawing, Callable[[Run], bool]]] = {
    "quality": (draw_quality, lambda _: True),
    "iterations": (_draw_iterations, lambda run: bool(np.any(run.columns["iterations"] > 1))),
    "seconds": (_draw_seconds, lambda run: any(bool(np.any(run.columns[f"seconds_{phase}"] > 0)) for phase in PHASES)),
    "enrichment": (_draw_enrichment, lambda run: bool(np.any(run.columns["enrichment_points"] > 0))),
    "non-orthogonality": (_draw_orthogonality, lambda run: bool(np.isfinite(run.columns["non_orthogonality"]).any())),
}
