"""The result as a table, which takes its place in the benchmarks' README."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from benchmarks.correction.cases import CASES
from benchmarks.correction.cost import Cost

__all__ = ["README", "fill", "table"]

README = Path(__file__).parents[1] / "README.md"

_BLOCK = re.compile(r"(<!-- benchmark: correction -->\n).*?(<!-- end -->)", re.DOTALL)
_HEAD = (
    "| mesh, motion | nodes | asked | standard | reached | freed | iterations "
    "| s | CPU s | at most | × limit | MB |\n"
    "|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|\n"
)


def table(costs: Mapping[str, Cost], machine: str) -> str:
    """A line for each case, and what it was measured on."""
    return _HEAD + "".join(_row(name, cost) for name, cost in costs.items()) + f"\n{machine}\n"


def _row(name: str, cost: Cost) -> str:
    """One line."""
    case = CASES[name]
    allowed = "" if case.seconds is None else f"{case.seconds:g}"
    return (
        f"| {case.mesh} {case.motion} | {cost.nodes} | {case.asked} | {cost.standard:.3f} | {cost.minimum:.3f} "
        f"| {cost.freed} | {cost.iterations} | {_seconds(cost.seconds)} | {_seconds(cost.cpu_seconds)} | {allowed} "
        f"| {cost.cpu_seconds / cost.limit_cpu_seconds:.1f} | {cost.peak_bytes / 1e6:.0f} |\n"
    )


def _seconds(value: float) -> str:
    """Two significant digits without an exponent."""
    return f"{value:.0f}" if value >= 10 else f"{value:.2g}"


def fill(text: str, page: Path = README) -> None:
    """Put the text between ``<!-- benchmark: correction -->`` and ``<!-- end -->``.

    Raises
    ------
    ValueError
        If the page has no such lines.
    """
    before = page.read_text(encoding="utf-8")
    if not _BLOCK.search(before):
        raise ValueError(f"{page.name}: expected a line '<!-- benchmark: correction -->' and then '<!-- end -->'")
    page.write_text(_BLOCK.sub(lambda m: m[1] + text + m[2], before), encoding="utf-8")
