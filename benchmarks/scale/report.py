"""The results as tables for the benchmarks' README."""

from __future__ import annotations

from benchmarks.scale.cases import CASES
from benchmarks.scale.figures import Figures, MachineLimits, Rates, Seconds, WireFigures
from benchmarks.scale.results import Results, growth
from benchmarks.scale.work import shares

__all__ = ["tables"]

_COST = (
    "| mesh, motion | nodes | boundary nodes | set-up | first step | step | iteration | brief | solve | displace "
    "| predict | growth | × pass | dense ÷ step |\n|---|" + "---:|" * 13 + "\n"
)
_QUALITY = (
    "| mesh, motion | MB | peak B/node | kept B/node | min size-skew | near the wall | inverted | boundary error |\n"
    "|---|" + "---:|" * 7 + "\n"
)
#: Below so many nodes the libraries' own allocations hide what a node takes.
_SMALL = 10_000

_WIRE = (
    "| mesh, motion | set-up | first step | step | iteration | wire's share | of an iteration | worker MB "
    "| × in flight |\n|---|" + "---:|" * 8 + "\n"
)


_SHARES = (
    "| mesh | displace: of bandwidth | of arithmetic | predict: of bandwidth | of arithmetic | step: of bandwidth "
    "| of arithmetic | × the limit |\n|---|" + "---:|" * 7 + "\n"
)


def tables(results: Results) -> str:
    """Tables of cost, memory and quality, and of the measurements over the network."""
    library = [name for name in CASES if name in results.library]
    wire = [name for name in CASES if name in results.wire]
    parts = ["Milliseconds of processor time (wall time):\n\n" + _COST + "".join(_cost(results, n) for n in library)]
    parts.append(_QUALITY + "".join(_quality(name, results.library[name]) for name in library))
    if wire:
        parts.append("Over the wire:\n\n" + _WIRE + "".join(_over_wire(name, results.wire[name]) for name in wire))
    steady = [name for name in library if CASES[name].kind == "steady"]
    parts.append("Shares of the machine's limits:\n\n" + _SHARES + "".join(_limits(results, name) for name in steady))
    return "\n".join([*parts, _machine(results) + "\n"])


def _cost(results: Results, name: str) -> str:
    """One line."""
    figures, case = results.library[name], CASES[name]
    exponent = growth(results, name)
    times = [figures.setup, figures.first, figures.step, figures.iteration, figures.brief]
    phases = [figures.solve, figures.displace, figures.predict]
    cells = [
        *(_both(seconds) for seconds in times),
        *(_milliseconds(seconds.cpu) for seconds in phases),
        "" if exponent is None else f"{exponent:.2f}",
        _digits(figures.step.cpu / results.limits.pass_seconds(figures, case.dimension)),
        _digits(results.limits.dense_seconds(figures) / figures.step.cpu),
    ]
    return f"| {case.mesh} {case.kind} | {figures.nodes} | {figures.boundary} | {' | '.join(cells)} |\n"


def _quality(name: str, figures: Figures) -> str:
    """One line."""
    case = CASES[name]
    memory = [figures.peak_bytes / figures.nodes, figures.kept_bytes / figures.nodes]
    per_node = " | ".join(f"{value:.0f}" if figures.nodes >= _SMALL else "" for value in memory)
    return (
        f"| {case.mesh} {case.kind} | {figures.resident_bytes / 1e6:.0f} | {per_node} | {figures.minimum:.3f} "
        f"| {figures.near_wall:.3f} | {figures.inverted} | {figures.boundary_error:.0e} |\n"
    )


def _over_wire(name: str, figures: WireFigures) -> str:
    """One line."""
    case = CASES[name]
    times = " | ".join(_both(seconds) for seconds in (figures.setup, figures.first, figures.step, figures.iteration))
    parts = " | ".join(f"{100 * share:.0f} %" for share in (figures.step_share, figures.iteration_share))
    memory = f"{figures.worker_bytes / 1e6:.0f} | {_digits(figures.worker_bytes / figures.flight_bytes)}"
    return f"| {case.mesh} {case.kind} | {times} | {parts} | {memory} |\n"


def _limits(results: Results, name: str) -> str:
    """One line."""
    case = CASES[name]
    rates = results.limits.rates(results.threads)
    found = shares(results.library[name], case.dimension, rates, results.threads)
    both = " | ".join(f"{100 * share.bandwidth:.0f} % | {100 * share.arithmetic:.0f} %" for share in found)
    return f"| {case.mesh} | {both} | {_digits(found[-1].times)} |\n"


def _machine(results: Results) -> str:
    """The machine of the measurement."""
    limits: MachineLimits = results.limits
    return (
        f"{results.machine} One thread copies {limits.bandwidth / 1e9:.1f} GB/s (read and written) and sums "
        f"{limits.pair_rate / 1e6:.0f} M pairs/s in dense numpy. Compiled loops: {_rates(limits.one)} on one thread, "
        f"{_rates(limits.all)} on {limits.threads}."
    )


def _rates(rates: Rates) -> str:
    return (
        f"{rates.triad / 1e9:.1f} GB/s triad, {rates.read / 1e9:.1f} GB/s read, {rates.arithmetic / 1e9:.0f} Gflop/s, "
        f"{rates.pairs / 1e9:.1f} Gpair/s"
    )


def _both(seconds: Seconds) -> str:
    return f"{_milliseconds(seconds.cpu)} ({_milliseconds(seconds.wall)})"


def _milliseconds(seconds: float) -> str:
    return _digits(1e3 * seconds)


def _digits(value: float) -> str:
    """Two significant digits without an exponent, from 10 on whole numbers."""
    return f"{value:.0f}" if value >= 10 else f"{value:.2g}"
