"""The result as a table for the benchmarks' README."""

from __future__ import annotations

from collections.abc import Mapping

from benchmarks.correction.cases import CASES
from benchmarks.correction.cost import Cost
from benchmarks.page import seconds_shown

__all__ = ["table"]

_HEAD = (
    "| mesh, motion | nodes | asked | standard | reached | freed | iterations "
    "| s | CPU s | at most | × limit | MB |\n"
    "|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|\n"
)


def table(costs: Mapping[str, Cost], machine: str) -> str:
    """A line for each case, and a line about the machine."""
    return _HEAD + "".join(_row(name, cost) for name, cost in costs.items()) + f"\n{machine}\n"


def _row(name: str, cost: Cost) -> str:
    """One line."""
    case = CASES[name]
    allowed = "" if case.seconds is None else f"{case.seconds:g}"
    return (
        f"| {case.mesh} {case.motion} | {cost.nodes} | {case.asked} | {cost.standard:.3f} | {cost.minimum:.3f} "
        f"| {cost.freed} | {cost.iterations} | {seconds_shown(cost.seconds)} "
        f"| {seconds_shown(cost.cpu_seconds)} | {allowed} | {cost.cpu_seconds / cost.limit_cpu_seconds:.1f} "
        f"| {cost.peak_bytes / 1e6:.0f} |\n"
    )
