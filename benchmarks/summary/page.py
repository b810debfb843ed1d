"""The page of a run: the aims, then every table, then the plot; also the blocks of the README files."""

from __future__ import annotations

from pathlib import Path

from benchmarks.correction.report import table as correction_table
from benchmarks.page import fill_block
from benchmarks.peers.comparison import Outcome
from benchmarks.peers.report import markdown as peers_tables
from benchmarks.peers.systems import SYSTEMS
from benchmarks.scale.picture import write_picture
from benchmarks.scale.report import tables as scale_tables
from benchmarks.summary.aims import Row, anchor, rows
from benchmarks.summary.evidence import Evidence

__all__ = ["aims_table", "fill_pages", "front_table", "page", "write_page", "write_plot"]

_ROOT = Path(__file__).parents[2]
FRONT = _ROOT / "README.md"
_PICTURE = _ROOT / "docs" / "images" / "scale.png"

#: Columns of the front page's table, and the rows with their systems; of several, the one that leaves the best minimum.
_FRONT_CASES = {
    "M3-T3-1": "wing in 3D, 50 k nodes, one large step",
    "M2-T1-1": "slab in 2D, 98 k nodes, one large step",
    "M1-T1-20": "slab in 2D, 723 nodes, 20 steps",
}
_FRONT_SYSTEMS = {
    "**mesh-motion server**, nothing set": ("ours",),
    '**mesh-motion server**, `correction = "optimised"`': ("ours-optimised",),
    '**mesh-motion server**, `correction_target = "maximum"`': ("ours-maximum",),
    "plain RBF (dense numpy, all boundary nodes)": ("dense-rbf",),
    "OpenFOAM 1912 displacementLaplacian, converged": ("openfoam-converged",),
    "… the better of its other settings": ("openfoam", "openfoam-uncorrected"),
    "Kratos laplacian": ("kratos-laplacian",),
    "Kratos structural similarity": ("kratos-similarity",),
}


def aims_table(evidence: Evidence) -> str:
    """The aims and their measured values."""
    found = rows(evidence)
    lines = "".join(f"| {row.what} | {row.asked} | {row.measured} | {_verdict(row)} |\n" for row in found)
    met, measured = sum(row.met is True for row in found), sum(row.met is not None for row in found)
    written = sum(row.as_written and row.met is False for row in found)
    counts = f"{met} of {measured} measured aims are met, {written} more with unscaled seconds."
    if measured < len(found):
        counts += f" {len(found) - measured} were not measured."
    factor = anchor(evidence)
    scale = f"All aims in seconds are multiplied by {factor.factor:.2f}: {factor.text}."
    left = f" Left out: {', '.join(evidence.left_out)}." if evidence.left_out else ""
    head = "| | aim | measured | met |\n|---|---:|---:|---|\n"
    return f"{head}{lines}\n{counts} {scale} {evidence.results.machine}{left}\n"


def _verdict(row: Row) -> str:
    if row.met is None:
        return ""
    return "yes" if row.met else "unscaled" if row.as_written else "**no**"


def page(evidence: Evidence) -> str:
    """Everything."""
    results = evidence.results
    parts = ["# Benchmarks of one run", "## Aims", aims_table(evidence)]
    if evidence.outcomes:
        parts += ["## System by system", peers_tables(_ordered(evidence.outcomes))]
    if results.library:
        parts += ["## Growth", scale_tables(results), "![seconds of a step against nodes](scale.png)"]
    if evidence.costs:
        parts += ["## Correction", correction_table(evidence.costs, results.machine)]
    return "\n\n".join(part.strip() for part in parts) + "\n"


def front_table(evidence: Evidence) -> str:
    """Lowest size-skew, inverted cells, seconds of a step, and OpenFOAM's face measures, for the front page."""
    head = f"| | {' | '.join(_FRONT_CASES.values())} |\n|---|---|---|---|\n"
    lines = ""
    for label, systems in _FRONT_SYSTEMS.items():
        cells = " | ".join(_front_cell(evidence, case, systems) for case in _FRONT_CASES)
        lines += f"| {label} | {cells} |\n"
    return f"{head}{lines}\n{_front_note(evidence)}\n"


def _front_note(evidence: Evidence) -> str:
    """The meaning of the second line of a table cell, and its value at rest."""
    rest = {
        name: found.verdict.rest_non_orthogonality
        for case, name in _FRONT_CASES.items()
        for found in evidence.outcomes
        if found.case == case and found.verdict
    }
    text = (
        "Second line: the largest non-orthogonality, as OpenFOAM's `checkMesh` has it, and the faces above 65° and 75°."
    )
    before = "; ".join(f"{', '.join(name.split(', ')[:2])}: {angle:.1f}°" for name, angle in rest.items())
    return f"{text}\nAt rest ({before})." if before else text


def _front_cell(evidence: Evidence, case: str, systems: tuple[str, ...]) -> str:
    """Outcome of the system with the best minimum."""
    found = [outcome for system in systems if (outcome := evidence.outcome(case, system))]
    best = max(found, key=lambda outcome: outcome.verdict.min_size_skew if outcome.verdict else 0.0, default=None)
    if best is None or best.verdict is None or best.measurement is None:
        return "not run"
    minimum = f"{best.verdict.min_size_skew:.3f}".replace("-", "−")
    minimum = f"**{minimum}**" if best.system.startswith("ours") else minimum
    minimum += f" (shape {best.verdict.min_shape:.2f})"
    seconds = "" if case.endswith("-20") else f", {_seconds(best.measurement.step)} s"
    verdict = best.verdict
    faces = f"{verdict.non_orthogonality:.1f}°, {verdict.faces_above_65} and {verdict.faces_above_75} faces"
    return f"{minimum}, {verdict.inverted} inverted{seconds}<br>{faces}"


def _seconds(value: float) -> str:
    """Two significant digits without an exponent."""
    return f"{value:.0f}" if value >= 10 else f"{value:.2g}"


def _ordered(outcomes: list[Outcome]) -> list[Outcome]:
    """Outcomes by case in order of appearance, and by system in the order of the list."""
    cases, systems = list(dict.fromkeys(outcome.case for outcome in outcomes)), list(SYSTEMS)
    return sorted(outcomes, key=lambda o: (cases.index(o.case), systems.index(o.system)))


def write_page(evidence: Evidence, out: Path) -> None:
    """Write ``bench.md`` and ``bench.json`` into the folder."""
    evidence.save(out / "bench.json")
    (out / "bench.md").write_text(page(evidence), encoding="utf-8")


def write_plot(evidence: Evidence, out: Path) -> None:
    """Write ``scale.png`` into the folder."""
    if evidence.results.library:
        write_picture(evidence.results, out / "scale.png", evidence.outcomes)


def fill_pages(evidence: Evidence) -> None:
    """Write the results into the README files and the documentation's plot."""
    if evidence.results.library:
        fill_block("aims", aims_table(evidence))
        fill_block("scale", scale_tables(evidence.results))
        write_picture(evidence.results, _PICTURE, evidence.outcomes)
    if evidence.costs:
        fill_block("correction", correction_table(evidence.costs, evidence.results.machine))
    if evidence.outcomes:
        fill_block("systems", peers_tables(_ordered(evidence.outcomes)) + f"\n{evidence.results.machine}\n")
        fill_block("front", front_table(evidence), FRONT)
