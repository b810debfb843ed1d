"""The result for people and for programs: a markdown table, a JSON file, a plot."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from benchmarks.peers.comparison import CASES, Outcome
from benchmarks.peers.meshes import MESHES
from benchmarks.peers.motions import MOTIONS
from benchmarks.peers.systems import SYSTEMS

__all__ = ["markdown", "write_report"]

_HEAD = (
    "| system | set-up s | step s | CPU s | MB | min size-skew | mean size-skew | inverted cells |\n"
    "|---|---:|---:|---:|---:|---:|---:|---:|\n"
)


def write_report(outcomes: Sequence[Outcome], machine: dict[str, object], out: Path) -> None:
    """Write ``peers.md``, ``peers.json`` and ``peers.png`` into ``out``."""
    content = {"machine": machine, "outcomes": [outcome.as_dict() for outcome in outcomes]}
    (out / "peers.json").write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    facts = "; ".join(f"{key}: {value}" for key, value in machine.items())
    (out / "peers.md").write_text(markdown(outcomes) + f"\n{facts}\n", encoding="utf-8")
    if any(outcome.verdict for outcome in outcomes):
        _plot(outcomes, out / "peers.png")


def markdown(outcomes: Sequence[Outcome]) -> str:
    """One table a case."""
    parts = []
    for name in dict.fromkeys(outcome.case for outcome in outcomes):
        rows = "".join(_row(outcome) for outcome in outcomes if outcome.case == name)
        parts.append(f"**{title(name)}**\n\n{_HEAD}{rows}")
    return "\n".join(parts)


def title(case: str) -> str:
    """``M1: slab in a square, …; translate …, in 20 steps``."""
    chosen = CASES[case]
    steps = "one step" if chosen.steps == 1 else f"{chosen.steps} steps"
    return f"{chosen.mesh}, {MESHES[chosen.mesh][0]}: {MOTIONS[chosen.motion].text}, in {steps}"


def _row(outcome: Outcome) -> str:
    """One line of a table; an inverted count in brackets is that of the worst step, where the end is better."""
    label = SYSTEMS[outcome.system].label
    cost, verdict = outcome.measurement, outcome.verdict
    if cost is None or verdict is None:
        return f"| {label} | {outcome.note} | | | | | | |\n"
    inverted = f"{verdict.inverted}"
    if verdict.most_inverted > verdict.inverted:
        inverted += f" (worst step {verdict.most_inverted})"
    memory = cost.peak_bytes / 1e6
    return (
        f"| {label} | {cost.setup_seconds:.2g} | {_seconds(cost.step)} | {_seconds(cost.step_cpu)} | {memory:.0f} "
        f"| {verdict.min_size_skew:.3f} | {verdict.mean_size_skew:.3f} | {inverted} |\n"
    )


def _seconds(value: float) -> str:
    """Two significant digits without an exponent."""
    return f"{value:.0f}" if value >= 10 else f"{value:.2g}"


def _plot(outcomes: Sequence[Outcome], path: Path) -> None:
    """Quality against time, one panel a case: right is slow, up is good, hollow markers have inverted cells."""
    import matplotlib as mpl  # noqa: PLC0415  an extra

    mpl.use("Agg")
    from matplotlib import pyplot as plt  # noqa: PLC0415

    cases = list(dict.fromkeys(outcome.case for outcome in outcomes))
    columns = 2 if len(cases) > 1 else 1
    rows = -(-len(cases) // columns)
    figure, axes = plt.subplots(rows, columns, figsize=(6.2 * columns, 3.4 * rows + 1), squeeze=False)
    styles = dict(zip(SYSTEMS, zip("osD^vP*Xh<>", [f"C{i}" for i in range(10)] * 2, strict=False), strict=False))
    for axis, case in zip(axes.flat, cases, strict=False):
        for outcome in outcomes:
            if outcome.case != case or outcome.measurement is None or outcome.verdict is None:
                continue
            marker, colour = styles[outcome.system]
            axis.plot(
                outcome.measurement.step,
                outcome.verdict.min_size_skew,
                marker,
                color=colour,
                markersize=9,
                fillstyle="none" if outcome.verdict.most_inverted else "full",
                label=SYSTEMS[outcome.system].label,
            )
        axis.set(
            xscale="log", xlabel="seconds a step", ylabel="min size-skew", title=title(case).replace(": ", "\n", 1)
        )
        axis.title.set_fontsize(9)
        axis.axhline(0, color="grey", linewidth=0.8)
        axis.grid(alpha=0.3)
    for axis in list(axes.flat)[len(cases) :]:
        axis.axis("off")
    handles = {label: h for axis in axes.flat for h, label in zip(*axis.get_legend_handles_labels(), strict=True)}
    figure.legend(handles.values(), handles.keys(), loc="lower center", ncols=2, fontsize=9)
    figure.suptitle("Mesh motion: quality after the motion against time (hollow: inverted cells)")
    figure.tight_layout(rect=(0, 0.14 / rows**0.5 * 1.4, 1, 0.98))
    figure.savefig(path, dpi=130)
    plt.close(figure)
