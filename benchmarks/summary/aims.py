"""The aims, row by row: the aim, the value that this run measured, and whether the value meets the aim.

Aims in seconds were set on one machine, where the textbook's dense sum (numpy, all boundary nodes are centres) took 4.4
s on M3 and 135 s on M4. A later run measures that sum too, and multiplies all aims in seconds by the ratio of the new
to the old time. Other load makes the sum slower and would make the aims easier, so the smallest of the known ratios
counts.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from benchmarks.scale.cases import CASES
from benchmarks.scale.figures import Figures, of_threads
from benchmarks.scale.results import exponent
from benchmarks.summary.evidence import Evidence

__all__ = ["Anchor", "Row", "anchor", "rows"]

#: Seconds of a steady step in the library.
_STEPS = {"M2": 0.007, "M3": 0.015, "M4": 0.045, "M5": 0.35, "W3": 0.025, "S3": 0.025}
#: Seconds of the large motion's correction, to the quality in the case's name.
_CORRECTIONS = {"M3-0.28": 0.3, "M4-0.25": 1.0, "M2-max": 1.7, "M3-max": 2.5}
#: Seconds of the dense sum, of IDWarp's step on M4, and of the others' set-up, where the aims were set.
_DENSE = {"M3-T3-1": 4.4, "M4-T3-1": 135.0}
_DENSE_PAIRS = 50e6
_IDWARP_STEP = 10.9
_SETUP = (("M3", "IDWarp", 2.3), ("M3", "preCICE", 13.4), ("M4", "IDWarp", 25.7))
_PEERS_CASES = {"M2": "M2-T1-1", "M3": "M3-T3-1", "M4": "M4-T3-1"}


@dataclass(frozen=True)
class Row:
    """One aim.

    Attributes
    ----------
    met : bool or None
        None if this run has not measured it.
    as_written : bool
        Whether the measured value meets the original aim, without the factor of the machine.
    """

    what: str
    asked: str
    measured: str
    met: bool | None
    as_written: bool = False


@dataclass(frozen=True)
class Anchor:
    """Seconds of this run over those of the machine where the aims were set, and the source of this ratio."""

    factor: float
    text: str


def anchor(evidence: Evidence) -> Anchor:
    """The smallest known ratio from the dense sum of this run: on M3, on M4, or from the rate of one tile."""
    rate = evidence.results.limits.pair_rate
    text = f"dense numpy sums {rate / 1e6:.0f} M pairs/s here and {_DENSE_PAIRS / 1e6:.0f} M there"
    known = [Anchor(_DENSE_PAIRS / rate, text)]
    for case, then in _DENSE.items():
        if (seconds := evidence.step(case, "dense-rbf")) is not None:
            text = f"dense numpy on {case[:2]} takes {seconds:.3g} s here and took {then:g} s there"
            known.append(Anchor(seconds / then, text))
    return min(known, key=lambda found: found.factor)


def rows(evidence: Evidence) -> list[Row]:
    """All of them."""
    factor = anchor(evidence).factor
    return [
        *_steps(evidence, factor),
        *_judging(evidence, factor),
        *_boundary(evidence),
        *_walls(evidence),
        *_ahead(evidence),
        *_setups(evidence, factor),
        *_growth(evidence),
        *_iterations(evidence),
        *_corrections(evidence, factor),
        *_derivatives(evidence),
        *_start(evidence, factor),
        *_wire(evidence),
        *_memory(evidence),
    ]


def _most(what: str, asked: float, measured: float | None, unit: str = "", note: str = "") -> Row:
    """A row whose measured value should be at most the aim."""
    text = "not measured" if measured is None else f"{measured:.3g}{unit}{note}"
    return Row(what, f"≤ {asked:.3g}{unit}", text, None if measured is None else measured <= asked)


def _seconds(what: str, asked: float, factor: float, measured: float | None, note: str = "") -> Row:
    """A row of seconds; its aim was set on another machine."""
    row = _most(what, asked * factor, measured, " s", note)
    as_written = measured is not None and measured <= asked
    return Row(what, f"{row.asked} ({asked:.3g} there)", row.measured, row.met, as_written)


def _least(what: str, asked: float, measured: float | None, unit: str = "", note: str = "") -> Row:
    """A row whose measured value should be at least the aim."""
    text = "not measured" if measured is None else f"{measured:.3g}{unit}{note}"
    return Row(what, f"≥ {asked:.3g}{unit}", text, None if measured is None else measured >= asked)


def _library(evidence: Evidence, mesh: str, kind: str = "steady") -> Figures | None:
    return evidence.results.library.get(f"{mesh}-{kind}")


def _step(evidence: Evidence, mesh: str) -> tuple[float | None, str]:
    """Seconds of a steady step, over the network if that was measured, and a note on how."""
    if wire := evidence.results.wire.get(f"{mesh}-steady"):
        return of_threads(wire.step, evidence.results.threads), ", over the wire"
    if figures := _library(evidence, mesh):
        return of_threads(figures.step, evidence.results.threads), ", in the library"
    return None, ""


def _steps(evidence: Evidence, factor: float) -> Iterator[Row]:
    """Compare each mesh's steady step with its aim; that of M4 also with IDWarp and with one pass over the mesh."""
    for mesh, asked in _STEPS.items():
        figures, case = _library(evidence, mesh), CASES[f"{mesh}-steady"]
        seconds = of_threads(figures.step, evidence.results.threads) if figures else None
        nodes = f", {figures.nodes / 1e3:.0f} k nodes" if figures else ""
        yield _seconds(f"{mesh}, {case.dimension}D{nodes}: steady step", asked, factor, seconds)
    seconds, how = _step(evidence, "M4")
    idwarp = None if seconds is None else _IDWARP_STEP * factor / seconds
    yield _least("M4: times faster than IDWarp", 75.0, idwarp, "", how)
    figures = _library(evidence, "M4")
    passes = None
    if figures:
        step = of_threads(figures.step, evidence.results.threads)
        passes = step / evidence.results.limits.pass_seconds(figures, 3)
    yield _most("M4: step / one pass over coordinates and connectivity", 14.0, passes)


def _judging(evidence: Evidence, factor: float) -> Iterator[Row]:
    """Aims for the quality of M4's cells: minimum and inverted cells alone, and with exact percentiles."""
    figures, threads = _library(evidence, "M4"), evidence.results.threads
    brief = of_threads(figures.judge_brief, threads) if figures else None
    share = of_threads(figures.predict, threads) / brief if figures and brief else None
    yield _seconds("M4: brief judging", 0.012, factor, brief)
    yield _most("M4: full judging / brief judging", 1.4, share)


def _boundary(evidence: Evidence) -> Iterator[Row]:
    """Aims for errors at boundary nodes before the nodes are set to their given positions."""
    for mesh in ("M2", "M7", "M3", "M4", "M5", "W2", "W3", "S2", "S3"):
        figures = _library(evidence, mesh)
        error = figures.boundary_error if figures else None
        text = f"{mesh}: error at {figures.boundary if figures else 'all'} boundary nodes"
        yield _most(text, 1e-10, error)


def _walls(evidence: Evidence) -> Iterator[Row]:
    """Aims for the quality next to the body after the large motion, relative to all boundary nodes as centres."""
    for mesh in ("M3", "M4", "M2", "M7"):
        truth, figures = evidence.truths.get(f"{mesh}-large"), _library(evidence, mesh, "large")
        share = 100 * figures.near_wall / truth.near_wall if figures and truth else None
        note = f" ({figures.near_wall:.3f} of {truth.near_wall:.3f})" if figures and truth else ""
        yield _least(f"{mesh}: quality next to the body / quality with all centres", 95.0, share, " %", note)


def _ahead(evidence: Evidence) -> Iterator[Row]:
    """Aims for the time of the fastest other system over ours, on the same motion and by the same clock."""
    for mesh, case in _PEERS_CASES.items():
        others = [
            (seconds, outcome.system)
            for outcome in evidence.outcomes
            if outcome.case == case and not outcome.system.startswith("ours")
            if (seconds := evidence.step(case, outcome.system)) is not None
        ]
        ours = evidence.step(case, "ours-plain")
        if not others or ours is None:
            yield Row(f"{mesh}: times faster than the fastest other system", "≥ 10", "not measured", None)
            continue
        seconds, system = min(others)
        yield _least(f"{mesh}: times faster than the fastest other system", 10.0, seconds / ours, "", f" ({system})")


def _setups(evidence: Evidence, factor: float) -> Iterator[Row]:
    """Aims for set-up: a tenth of that of other systems."""
    for mesh, other, seconds in _SETUP:
        figures = _library(evidence, mesh)
        measured = of_threads(figures.setup, evidence.results.threads) if figures else None
        yield _seconds(f"{mesh}: set-up (aim: a tenth of {other}'s)", 0.1 * seconds, factor, measured)


def _growth(evidence: Evidence) -> Iterator[Row]:
    """Exponent and memory of the largest."""
    yield _most("step ~ nodesᵖ from M3 to M5: p", 1.1, exponent(evidence.results, "M3-steady", "M5-steady"))
    figures = _library(evidence, "M5")
    yield _most("M5: largest memory, set-up included", 4.0, figures.resident_bytes / 1e9 if figures else None, " GB")


_NO_ITERATIONS = (("", None), (" in full", None))


def _iterations(evidence: Evidence) -> Iterator[Row]:
    """Aims for the session's first Move over a step's first, and for a later iteration over its step's first."""
    for mesh in ("M3", "M4", "M5"):
        figures, threads = _library(evidence, mesh), evidence.results.threads
        step = of_threads(figures.step, threads) if figures else 1.0
        first = of_threads(figures.first, threads) / step if figures else None
        yield _most(f"{mesh}: first move of a session / next move", 1.5, first)
        for name, seconds in (("", figures.brief), (" in full", figures.iteration)) if figures else _NO_ITERATIONS:
            share = of_threads(seconds, threads) / step if seconds else None
            yield _most(f"{mesh}: later iteration{name} / first iteration", 0.6, share)


def _corrections(evidence: Evidence, factor: float) -> Iterator[Row]:
    """The large motion corrected."""
    for case, asked in _CORRECTIONS.items():
        cost = evidence.costs.get(case)
        mesh, to = case.split("-")
        if to != "max":
            yield _least(f"{mesh}: corrected minimum size-skew", float(to), cost.minimum if cost else None)
        note = f" (reached {cost.minimum:.3f})" if cost else ""
        way = "to the maximum" if to == "max" else f"to {to}"
        yield _seconds(f"{mesh}: correction {way}", asked, factor, cost.seconds if cost else None, note)


def _derivatives(evidence: Evidence) -> Iterator[Row]:
    """Aims for Jᵀ w, including the preparation for the first vector, and for the headroom, over the step before."""
    threads = evidence.results.threads
    for mesh in ("M3", "M4"):
        cost = evidence.derivatives.get(mesh)
        kinds = (
            ("with a correction", "", 1.0),
            ("that needs no correction", "idle_", 0.5),
            ("without correction", "plain_", 0.5),
        )
        for name, prefix, asked in kinds:
            step, prepared, one, headroom = (
                of_threads(getattr(cost, prefix + part), threads) if cost else 1.0
                for part in ("step", "prepared", "cotangent", "headroom")
            )
            note = f" ({one / step:.2g} for each further vector)"
            share = (prepared + one) / step if cost else None
            yield _most(f"{mesh}: Jᵀ w / step {name}", asked, share, "", note)
            yield _most(f"{mesh}: headroom / step {name}", 0.05, headroom / step if cost else None)


def _start(evidence: Evidence, factor: float) -> Iterator[Row]:
    """Aims for the waiting time before a user's first step, and for the memory of a process."""
    found = evidence.results.start
    yield _seconds("`mesh-motion --help`", 0.25, factor, found.help.wall if found else None)
    yield _seconds("`serve` until it is ready, processor time", 0.4, factor, found.ready.cpu if found else None)
    yield _seconds("`connect()` and opening M3", 0.8, factor, found.opened.wall if found else None)
    yield _most("a small session's process", 100.0, found.worker_bytes / 1e6 if found else None, " MB")
    text = "`play` of one step of 22 k nodes with pictures and VTU, processor time"
    yield _seconds(text, 3.0, factor, found.played.cpu if found else None)


def _wire(evidence: Evidence) -> Iterator[Row]:
    """Aims for opening, for the communication, and for the worker's memory."""
    opened = evidence.results.wire.get("M4-steady")
    yield _most(
        "M4: opening over the wire", 1.2, of_threads(opened.setup, evidence.results.threads) if opened else None, " s"
    )
    for mesh in ("M4", "M5"):
        wire = evidence.results.wire.get(f"{mesh}-steady")
        yield _most(f"{mesh}: share of the wire in a step", 10.0, 100 * wire.step_share if wire else None, " %")
        times = wire.worker_bytes / wire.flight_bytes if wire else None
        yield _most(f"{mesh}: worker's memory / arrays in flight", 3.0, times)


def _memory(evidence: Evidence) -> Iterator[Row]:
    """Bytes a node beyond the mesh."""
    for mesh in ("M7", "M4", "M5"):
        figures = _library(evidence, mesh)
        peak = figures.peak_bytes / figures.nodes if figures else None
        kept = f" at most, {figures.kept_bytes / figures.nodes:.0f} kept" if figures else ""
        yield _most(f"{mesh}: bytes per node in addition to the mesh", 200.0, peak, "", kept)
