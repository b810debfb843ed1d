"""Explicit iterations on random motions: which decomposition of B corrects cells best?"""

from __future__ import annotations

from typing import Any

import numpy as np
from mesh_motion_numerics.correction.enrichment.explicit_iterations import ExplicitSettings, explicit_iterations

from docs.studies.beyond._motions import RADIUS, Body, random_motions, stored
from docs.studies.study import Cell, Outcome, Picture, Study, Table
from docs.studies.thesis._cell_corrections import CELL_CORRECTIONS

#: Mesh → motions of the full study, of the quick one.
MESHES = {"thesis_block": (40, 6), "correction_slab": (40, 6), "correction_box": (20, 2)}
RELAXATIONS = (1.3, 2.0)


def run(quick: bool) -> Outcome:
    rows: list[list[Cell]] = []
    minima: dict[str, dict[str, list[float]]] = {}
    for name, counts in MESHES.items():
        body, count = stored(name), counts[1 if quick else 0]
        problems = list(random_motions(body, count, seed=41))
        standard = np.array([body.judge().quality(p.standard).min() for p in problems])
        rows.append([name, "none", None, f"{np.count_nonzero(standard > 0)}/{count}", 0, float(standard.mean()), None])
        minima[name] = {}
        for relaxation in RELAXATIONS:
            for kind in CELL_CORRECTIONS:
                row, reached = _tried(body, problems, kind, relaxation)
                rows.append([name, *row])
                if relaxation == RELAXATIONS[-1]:
                    minima[name][kind] = reached
    columns = ("mesh", "decomposition", "relaxation", "valid", "at the threshold", "mean minimum", "mean iterations")
    caption = "Fresh random shifts and turns that the standard motion leaves below size-skew 0.2; at most 20 points."
    return Outcome((Table(columns, rows, caption, digits=3),), (Picture(lambda f: _draw(f, minima), _CAPTION, (9, 3)),))


_CAPTION = "Minimum size-skew of each motion with relaxation 2, sorted."


def _tried(body: Body, problems: Any, kind: str, relaxation: float) -> tuple[list[Cell], list[float]]:
    """A row of the table, and the minimum of each motion."""
    settings = ExplicitSettings(enrichment_radius=RADIUS, relaxation=relaxation, correct_cell=CELL_CORRECTIONS[kind])
    found = [explicit_iterations(problem, settings) for problem in problems]
    minima = [float(body.judge().quality(f.points).min()) for f in found]
    valid = sum(minimum > 0 for minimum in minima)
    iterations = [len(f.history) - 1 for f in found]
    reached = sum(f.reached for f in found)
    row: list[Cell] = [kind, relaxation, f"{valid}/{len(found)}", reached, float(np.mean(minima))]
    return [*row, float(np.mean(iterations))], minima


def _draw(figure: Any, minima: dict[str, dict[str, list[float]]]) -> None:
    for ax, (name, found) in zip(figure.subplots(1, len(minima)), minima.items(), strict=True):
        for kind, reached in found.items():
            ax.plot(np.linspace(0, 1, len(reached)), np.sort(reached), label=kind, lw=1.3)
        ax.axhline(0, color="k", lw=0.5)
        ax.set(title=name.replace("_", " "), xlabel="share of the motions", ylim=(-0.6, 0.4))
        ax.legend(fontsize=8, loc="lower right")
    figure.axes[0].set_ylabel("minimum size-skew")


def claims(outcome: Outcome) -> None:
    rows = outcome.tables[0].rows
    for name in MESHES:
        mean = {(row[1], row[2]): float(row[5]) for row in rows if row[0] == name}
        valid = {(row[1], row[2]): int(str(row[3]).split("/")[0]) for row in rows if row[0] == name}
        assert valid["polar", 2.0] >= valid["eigen", 2.0], name
        assert mean["polar", 2.0] > mean["eigen", 2.0] - 0.01, name
        assert mean["qr", 2.0] < mean["polar", 2.0], name


STUDY = Study(
    "Is a cell corrected better by its polar stretch than by its eigenvalues?",
    '§5.2.3, §6.2.3 of the thesis: polar decomposition "as a valid idea for further research"',
    run,
    claims,
    (
        "docs.studies.thesis._cell_corrections.polar_correction",
        "mesh_motion_numerics.correction.enrichment.explicit_iterations.explicit_iterations",
    ),
)
