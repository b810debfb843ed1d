"""Radial basis functions over the distance, and the effect of one of them for a single displaced node."""

from __future__ import annotations

from typing import Any

import numpy as np
from mesh_motion_numerics.interpolation.kernels import BASES, values

from docs.studies.study import Outcome, Picture, Study, Table

SHOWN = ("wendland-c0", "wendland-c2", "wendland-c4", "ctps-c1", "tps", "gauss")
SHARES = (0.25, 0.5, 0.75, 1.0)


def run(quick: bool) -> Outcome:
    """Values at shares of the support radius."""
    del quick
    rows = [[name, *(float(values(BASES[name], np.array([share]))[0]) for share in SHARES)] for name in SHOWN]
    table = Table(("function", *(f"at {share:g} R" for share in SHARES)), rows, digits=3)
    caption = "Six of the fourteen functions over the distance from their node, in support radii."
    return Outcome([table], [Picture(draw, caption, size=(7.5, 3.6))])


def draw(figure: Any) -> None:
    """A curve each."""
    axes = figure.subplots()
    distance = np.linspace(0.0, 1.2, 400)
    for name in SHOWN:
        axes.plot(distance, values(BASES[name], distance), label=name, linewidth=2.4 if name == "wendland-c2" else 1.2)
    axes.axvline(1.0, color="0.6", linewidth=0.8)
    axes.set_xlabel("distance / R")
    axes.set_ylabel("φ")
    axes.set_ylim(-0.25, 1.6)
    axes.legend(fontsize=8, ncols=2)


def claims(outcome: Outcome) -> None:
    """Check that the compact functions end at R, and that the default falls from 1 without a kink."""
    for name, *shown in outcome.tables[0].rows:
        if name.startswith(("wendland", "ctps")):
            assert abs(shown[-1]) < 1e-12
    near = values(BASES["wendland-c2"], np.array([0.0, 1e-4]))
    assert near[0] == 1.0
    assert abs(near[1] - near[0]) < 1e-6


STUDY = Study(
    title="How far does a boundary node reach?",
    source="Basis functions",
    run=run,
    claims=claims,
    functions=("mesh_motion_numerics.interpolation.kernels.BASES",),
)
