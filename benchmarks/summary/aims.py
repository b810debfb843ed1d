"""What was asked for, row by row: the aim, what this run measured, and whether that meets it.

Seconds were asked for on one machine, where the textbook's dense sum (numpy, all boundary nodes are centres) took 4.9 s
on M3 and 151 s on M4. A run on another machine, or a slower day, measures that sum too: all seconds that were asked for
are multiplied by what it takes now over what it took then. Other load makes that sum slower, and the aims with it: of
the ratios that are known the smallest counts.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks.scale.cases import CASES
from benchmarks.scale.figures import Figures, of_threads
from benchmarks.scale.results import exponent
from benchmarks.summary.evidence import Evidence

__all__ = ["Anchor", "Row", "anchor", "rows"]

#: Seconds of a step that were asked for, by nodes; in between, in proportion.
_NODES, _SECONDS = (50_144, 495_520, 4_887_591), (0.06, 0.16, 1.2)
#: Seconds of the dense sum, of IDWarp's step on M4, and of the others' set-up, where the aims were set.
_DENSE = {"M3-T3-1": 4.9, "M4-T3-1": 151.0}
_DENSE_PAIRS = 45e6
_IDWARP_STEP = 12.2
_SETUP = (("M3", "IDWarp", 2.6), ("M3", "preCICE", 15.0), ("M4", "IDWarp", 28.7))
_PEERS_CASES = {"M2": "M2-T1-1", "M3": "M3-T3-1", "M4": "M4-T3-1"}


@dataclass(frozen=True)
class Row:
    """One aim.

    Attributes
    ----------
    what, asked, measured : str
    met : bool or None
        None where this run has not measured it.
    """

    what: str
    asked: str
    measured: str
    met: bool | None


@dataclass(frozen=True)
class Anchor:
    """Seconds of this run over those of the machine where the aims were set, and where that is from."""

    factor: float
    text: str


def anchor(evidence: Evidence) -> Anchor:
    """From the dense sum of this run, M3's or M4's, or the rate of a tile of it: the smallest of those known."""
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
        *_shapes(evidence, factor),
        *_boundary(evidence),
        *_walls(evidence),
        *_ahead(evidence),
        *_setups(evidence, factor),
        *_growth(evidence),
        *_iterations(evidence),
        *_corrections(evidence, factor),
        *_wire(evidence),
        *_memory(evidence),
    ]


def _most(what: str, asked: float, measured: float | None, unit: str = "", note: str = "") -> Row:
    """A row whose figure should be at most what was asked."""
    text = "not measured" if measured is None else f"{measured:.3g}{unit}{note}"
    return Row(what, f"≤ {asked:.3g}{unit}", text, None if measured is None else measured <= asked)


def _least(what: str, asked: float, measured: float | None, unit: str = "", note: str = "") -> Row:
    """A row whose figure should be at least what was asked."""
    text = "not measured" if measured is None else f"{measured:.3g}{unit}{note}"
    return Row(what, f"≥ {asked:.3g}{unit}", text, None if measured is None else measured >= asked)


def _library(evidence: Evidence, mesh: str, kind: str = "steady") -> Figures | None:
    return evidence.results.library.get(f"{mesh}-{kind}")


def _step(evidence: Evidence, mesh: str) -> tuple[float | None, str]:
    """Seconds of a steady step, over the wire where that was measured, and how."""
    if wire := evidence.results.wire.get(f"{mesh}-steady"):
        return of_threads(wire.step, evidence.results.threads), ", over the wire"
    if figures := _library(evidence, mesh):
        return of_threads(figures.step, evidence.results.threads), ", in the library"
    return None, ""


def _asked(nodes: float) -> float:
    """Seconds of a step on the machine where the aims were set."""
    return float(np.interp(nodes, _NODES, _SECONDS))


def _steps(evidence: Evidence, factor: float) -> Iterator[Row]:
    """Steady steps by size, and M4's against IDWarp and against a pass over the mesh."""
    for mesh, nodes in (("M3", 50_144), ("M4", 495_520), ("M5", 4_887_591), ("M2", 98_444), ("M7", 999_196)):
        seconds, how = _step(evidence, mesh)
        dimension = CASES[f"{mesh}-steady"].dimension
        text = f"{mesh}, {dimension}D, {nodes / 1e3:.0f} k nodes: steady step"
        yield _most(text, _asked(nodes) * factor, seconds, " s", how)
    seconds, how = _step(evidence, "M4")
    idwarp = None if seconds is None else _IDWARP_STEP * factor / seconds
    yield _least("M4: times faster than IDWarp", 75.0, idwarp, "", how)
    figures = _library(evidence, "M4")
    passes = None
    if figures and seconds is not None:
        passes = seconds / evidence.results.limits.pass_seconds(figures, 3)
    yield _most("M4: step in passes over coordinates and connectivity", 32.0, passes, "", how)


def _shapes(evidence: Evidence, factor: float) -> Iterator[Row]:
    """Domains 50 bodies wide, spacing × 30."""
    for mesh, text in (
        ("W2", "2D, 50 bodies wide"),
        ("W3", "3D, 50 bodies wide"),
        ("S2", "2D, spacing × 30"),
        ("S3", "3D, spacing × 30"),
    ):
        figures = _library(evidence, mesh)
        seconds, how = _step(evidence, mesh)
        nodes = figures.nodes if figures else 0
        yield _most(f"{mesh}, {text}: steady step", _asked(nodes) * factor, seconds, " s", how)


def _boundary(evidence: Evidence) -> Iterator[Row]:
    """Errors at boundary nodes before they are put where they were told to be."""
    for mesh in ("M2", "M7", "M3", "M4", "M5", "W2", "W3", "S2", "S3"):
        figures = _library(evidence, mesh)
        error = figures.boundary_error if figures else None
        text = f"{mesh}: error at {figures.boundary if figures else 'all'} boundary nodes"
        yield _most(text, 1e-10, error)


def _walls(evidence: Evidence) -> Iterator[Row]:
    """Quality next to the body after the large motion, against all boundary nodes as centres."""
    for mesh in ("M3", "M4", "M2", "M7"):
        truth, figures = evidence.truths.get(f"{mesh}-large"), _library(evidence, mesh, "large")
        share = 100 * figures.near_wall / truth.near_wall if figures and truth else None
        note = f" ({figures.near_wall:.3f} of {truth.near_wall:.3f})" if figures and truth else ""
        yield _least(f"{mesh}: quality next to the body, of all centres'", 95.0, share, " %", note)


def _ahead(evidence: Evidence) -> Iterator[Row]:
    """The fastest of the other systems over ours, on the same motion by the same clock."""
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
    """A tenth of the others' set-up."""
    for mesh, other, seconds in _SETUP:
        figures = _library(evidence, mesh)
        measured = of_threads(figures.setup, evidence.results.threads) if figures else None
        yield _most(f"{mesh}: set-up, a tenth of {other}'s", 0.1 * seconds * factor, measured, " s")


def _growth(evidence: Evidence) -> Iterator[Row]:
    """Exponent and memory of the largest."""
    yield _most("step ~ nodesᵖ from M3 to M5: p", 1.1, exponent(evidence.results, "M3-steady", "M5-steady"))
    figures = _library(evidence, "M5")
    yield _most("M5: largest memory, set-up included", 4.0, figures.resident_bytes / 1e9 if figures else None, " GB")


_NO_ITERATIONS = (("", None), (" told in full", None))


def _iterations(evidence: Evidence) -> Iterator[Row]:
    """A later iteration over the first of its step."""
    for mesh in ("M3", "M4", "M5"):
        figures, threads = _library(evidence, mesh), evidence.results.threads
        step = of_threads(figures.step, threads) if figures else 1.0
        for name, seconds in (("", figures.brief), (" told in full", figures.iteration)) if figures else _NO_ITERATIONS:
            share = of_threads(seconds, threads) / step if seconds else None
            yield _most(f"{mesh}: a later iteration{name}, of the first", 0.6, share)


def _corrections(evidence: Evidence, factor: float) -> Iterator[Row]:
    """The large motion corrected."""
    for case, asked, seconds in (("M3-0.28", 0.28, 6.0), ("M4-0.25", 0.25, 45.0)):
        cost = evidence.costs.get(case)
        mesh = case[:2]
        yield _least(f"{mesh}: corrected minimum size-skew", asked, cost.minimum if cost else None)
        half = "" if not cost else f" (the goal: {0.5 * seconds * factor:.3g} s)"
        yield _most(f"{mesh}: seconds of that correction", seconds * factor, cost.seconds if cost else None, " s", half)


def _wire(evidence: Evidence) -> Iterator[Row]:
    """The way there and back, and what the worker keeps."""
    for mesh in ("M4", "M5"):
        wire = evidence.results.wire.get(f"{mesh}-steady")
        yield _most(f"{mesh}: wire's share of a step", 10.0, 100 * wire.step_share if wire else None, " %")
        times = wire.worker_bytes / wire.flight_bytes if wire else None
        yield _most(f"{mesh}: worker's memory over the arrays in flight", 3.0, times)


def _memory(evidence: Evidence) -> Iterator[Row]:
    """Bytes a node beyond the mesh."""
    for mesh in ("M7", "M4", "M5"):
        figures = _library(evidence, mesh)
        peak = figures.peak_bytes / figures.nodes if figures else None
        kept = f" at most, {figures.kept_bytes / figures.nodes:.0f} kept" if figures else ""
        yield _most(f"{mesh}: bytes a node beyond the mesh", 200.0, peak, "", kept)
