"""Tables 2.1 and 2.2: the fourteen basis functions and their properties.

The order at which a smooth function is approached is set by the first singular term of φ at the centre, ξ^β (β odd) or
ξ^β log ξ: the Fourier transform then falls as |ω|^(−d−β), the native space is the Sobolev space of order (d + β)/2, and
away from the boundary the error falls as h^(d+β), twice that order (R. Schaback, Math. Comp. 68 (1999) 201–216).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from mesh_motion_numerics.interpolation import evaluation
from mesh_motion_numerics.interpolation.interpolant import factorize
from mesh_motion_numerics.interpolation.kernels import BASES, Basis, values
from mesh_motion_numerics.mesh.roles import BoundaryRoles
from numpy.typing import NDArray

from docs.studies.moved_bodies import Turn, final_quality, stored
from docs.studies.study import Outcome, Picture, Study, Table

Floats = NDArray[np.float64]

_PRINTED = [basis for basis in BASES.values() if basis.number]

#: β of the first singular term of φ at ξ = 0; none for analytic functions, whose error falls faster than any power.
SINGULAR = {
    "wendland-c0": 1,
    "wendland-c2": 3,
    "wendland-c4": 5,
    "wendland-c6": 7,
    "ctps-c0": 1,
    "ctps-c1": 2,
    "ctps-c2a": 3,
    "ctps-c2b": 3,
    "tps": 2,
}
THESIS_NAMES = {
    "wendland-c0": "CP C0",
    "wendland-c2": "CP C2",
    "wendland-c4": "CP C4",
    "wendland-c6": "CP C6",
    "ctps-c0": "CTPS C0",
    "ctps-c1": "CTPS C1",
    "ctps-c2a": "CTPS C2a",
    "ctps-c2b": "CTPS C2b",
    "gauss": "Gauss",
}
#: The thesis' block motions that fit into its mesh, and a mild one that most functions survive.
MOTIONS = {"dx −0.15": Turn((-0.15, 0.0)), "dx −0.3": Turn((-0.3, 0.0)), "+30°": Turn((0.0, 0.0), 30.0)}
COMPACT_RADIUS, SHAPE = 0.5, 0.1


def radius_of(basis: Basis) -> float:
    """The thesis' support radius, or the length scale of a shape parameter."""
    return COMPACT_RADIUS if basis.compact else SHAPE


def interpolation_error(basis: Basis, n: int) -> float:
    """RMS error of a bump on the unit square from a lattice of n × n points."""
    axis = np.linspace(0.0, 1.0, n)
    lattice = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    places = np.random.default_rng(0).uniform(0.2, 0.8, (2000, 2))
    radius = COMPACT_RADIUS if basis.compact else COMPACT_RADIUS / 10.0
    found = factorize(lattice, basis=basis.name, support_radius=radius).solve(_bump(lattice))
    error = evaluation.displacement(found, places) - _bump(places)
    return float(np.sqrt(np.mean(error**2)))


def _bump(points: Floats) -> Floats:
    """(n, 1) values of a Gaussian that is nearly zero on the boundary, so that this does not limit the order."""
    return np.asarray(np.exp(-40.0 * np.sum((points - 0.5) ** 2, axis=1))[:, None])


def measured_order(basis: Basis, coarse: int, fine: int) -> float:
    """Order between two lattices."""
    ratio = interpolation_error(basis, coarse) / interpolation_error(basis, fine)
    return float(np.log(ratio) / np.log((fine - 1) / (coarse - 1)))


def condition_number(basis: Basis, points: Floats) -> float:
    """2-norm condition of the matrix of points (n, d); for conditional functions with the polynomial."""
    distance = np.linalg.norm(points[:, None] - points, axis=2)
    matrix = values(basis, distance / radius_of(basis))
    if basis.needs_polynomial:
        p = np.column_stack([np.ones(len(points)), points])
        null = np.linalg.qr(p, mode="complete")[0][:, p.shape[1] :]
        matrix = null.T @ matrix @ null
    return float(np.linalg.cond(matrix))


def smallest_transform(basis: Basis) -> float:
    """Smallest Fourier transform in 3D of a compact function relative to the largest, for wave numbers up to 100/R."""
    node, weight = np.polynomial.legendre.leggauss(1000)
    r, wave = (node + 1.0) / 2.0, np.linspace(0.05, 100.0, 1000)
    moments = np.sin(wave[:, None] * r) * (r * values(basis, r) * weight / 2.0)
    transform = moments.sum(axis=1) / wave
    return float(transform.min() / transform.max())


def run(quick: bool) -> Outcome:
    """One row a function."""
    mesh = stored("tests/references/thesis_block")
    boundary = mesh.points[BoundaryRoles.from_patches(mesh.patches).all]
    lattices = (17, 25) if quick else (33, 49)
    rows = [_row(basis, boundary, lattices) for basis in sorted(_PRINTED, key=lambda b: b.number)]
    smallest = min(smallest_transform(basis) for basis in _PRINTED if basis.compact)
    text = (
        f"Compact functions with R = {COMPACT_RADIUS} as in the thesis' tables, shape parameters {SHAPE}; the order "
        f"from lattices of {lattices[0]}² and {lattices[1]}² points in 2D (theory: 2 + β); condition number of the "
        f"{len(boundary)} boundary nodes of the block's mesh; minimum size-skew (signed) after one uncorrected step. "
        f"The 3D Fourier transforms of the eight compact functions, for wave numbers up to 100/R, are all positive "
        f"(smallest {smallest:.1g} of the largest): with 80/3 in place of the printed 20/3, CTPS C1 is among them."
    )
    columns = ("no.", "thesis", "key", "φ(ξ)", "matrix", "∇φ at a centre", "order", "theory", "condition", *MOTIONS)
    table = Table(columns, rows, digits=3)
    return Outcome([table], [Picture(draw, "The fourteen functions of Tables 2.1 and 2.2.")], text)


def _row(basis: Basis, boundary: Floats, lattices: tuple[int, int]) -> list[Any]:
    """One function's row."""
    definite = basis.definiteness + (f", order {basis.order}" if basis.order else "")
    head = [basis.number, THESIS_NAMES.get(basis.name, basis.name.upper()), f"`{basis.name}`", basis.formula]
    gradient = "yes" if basis.gradient_at_centre else "no"
    if basis.unusable:
        return [*head, "singular: refused", gradient, None, None, None, *(None for _ in MOTIONS)]
    beta = SINGULAR.get(basis.name)
    theory = "spectral" if beta is None else f"{2 + beta}" + (" (log)" if basis.name == "ctps-c2a" else "")
    choices = {"basis": basis.name, "support_radius": radius_of(basis), "correction": "none", "allow_invalid": True}
    model = stored("tests/references/thesis_block").model(**choices)
    qualities = [final_quality(model, turn) for turn in MOTIONS.values()]
    order, condition = measured_order(basis, *lattices), condition_number(basis, boundary)
    return [*head, definite, gradient, order, theory, condition, *qualities]


def draw(figure: Any) -> None:
    """Compact functions left, global ones right."""
    xi = np.linspace(0.0, 2.5, 251)
    axes = figure.subplots(1, 2)
    for basis in _PRINTED:
        shown = xi <= 1.0 if basis.compact else xi <= 2.5
        name = THESIS_NAMES.get(basis.name, basis.name.upper())
        axes[0 if basis.compact else 1].plot(xi[shown], values(basis, xi[shown]), label=name)
    for axis, title in zip(axes, ("Table 2.1: compact support", "Table 2.2: global support"), strict=True):
        axis.set(title=title, xlabel="ξ = r/R", ylabel="φ(ξ)")
        axis.legend(fontsize=8)
        axis.grid(alpha=0.3)


def claims(outcome: Outcome) -> None:
    """Check the theoretical orders, and that rough functions are better conditioned than smooth ones."""
    table = outcome.tables[0]
    assert len(table.rows) == len(_PRINTED) == 14
    measured = dict(zip(table.column("key"), table.column("order"), strict=True))
    for name, beta in SINGULAR.items():
        assert 0.85 * (2 + beta) < measured[f"`{name}`"] < 1.45 * (2 + beta), name
    assert all(measured[f"`{name}`"] > 6.0 for name in ("mqb", "imqb", "iqb", "gauss"))
    condition = dict(zip(table.column("key"), table.column("condition"), strict=True))
    rising = [condition[f"`wendland-c{k}`"] for k in (0, 2, 4, 6)]
    assert rising == sorted(rising)
    assert "all positive (smallest -" not in outcome.text
    mild = dict(zip(table.column("key"), table.column("+30°"), strict=True))
    assert mild["`wendland-c2`"] > 0 < mild["`tps`"]


STUDY = Study(
    title="What are the fourteen basis functions worth?",
    source="Tables 2.1, 2.2 (equations 2.1–2.7)",
    run=run,
    claims=claims,
    functions=(
        "mesh_motion_numerics.interpolation.kernels.BASES",
        "mesh_motion_numerics.interpolation.kernels.values",
        "mesh_motion_numerics.interpolation.kernels.slopes",
        "mesh_motion_numerics.interpolation.interpolant.factorize",
    ),
)
