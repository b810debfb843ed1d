"""The result for people and for programs: a markdown table, a JSON file, a plot."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from benchmarks.page import seconds_shown
from benchmarks.peers.comparison import Outcome, name_in_words
from benchmarks.peers.picture import write_picture
from benchmarks.peers.systems import SYSTEMS

__all__ = ["markdown", "write_report"]

_HEAD = (
    "| system | set-up s | step s | CPU s | MB | min shape | min size-skew | near the wall | mean | inverted |\n"
    "|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|\n"
)


def write_report(outcomes: Sequence[Outcome], machine: dict[str, object], out: Path) -> None:
    """Write ``peers.md``, ``peers.json`` and ``peers.png`` into ``out``."""
    content = {"machine": machine, "outcomes": [outcome.as_dict() for outcome in outcomes]}
    (out / "peers.json").write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    facts = "; ".join(f"{key}: {value}" for key, value in machine.items())
    (out / "peers.md").write_text(markdown(outcomes) + f"\n{facts}\n", encoding="utf-8")
    if any(outcome.verdict for outcome in outcomes):
        write_picture(outcomes, out / "peers.png")


def markdown(outcomes: Sequence[Outcome]) -> str:
    """One table a case."""
    parts = []
    for name in dict.fromkeys(outcome.case for outcome in outcomes):
        rows = "".join(_row(outcome) for outcome in outcomes if outcome.case == name)
        parts.append(f"**{name_in_words(name)}**\n\n{_HEAD}{rows}")
    return "\n".join(parts)


def _row(outcome: Outcome) -> str:
    """One line of a table; a number of inverted cells in brackets is that of the worst step, if the end is better."""
    label = SYSTEMS[outcome.system].label
    cost, verdict = outcome.measurement, outcome.verdict
    if cost is None or verdict is None:
        return f"| {label} | {outcome.note} | | | | | | | | |\n"
    inverted = f"{verdict.inverted}"
    if verdict.most_inverted > verdict.inverted:
        inverted += f" (worst step {verdict.most_inverted})"
    memory = cost.peak_bytes / 1e6
    return (
        f"| {label} | {cost.setup_seconds:.2g} | {seconds_shown(cost.step)} | {seconds_shown(cost.step_cpu)} "
        f"| {memory:.0f} | {verdict.min_shape:.3f} | {verdict.min_size_skew:.3f} | {verdict.near_wall:.3f} "
        f"| {verdict.mean_size_skew:.3f} | {inverted} |\n"
    )
