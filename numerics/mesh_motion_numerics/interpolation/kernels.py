"""The table of basis functions: thesis Tables 2.1 and 2.2 and a sum, with their requirements on an interpolation.

A basis is chosen by name. One row of :data:`BASES` has everything that an interpolation must know about it: whether its
support is compact, for which polynomial its matrix is definite, whether a gradient exists at a centre, what the support
radius means for it. An unusable row stays in the table with the reason.

References
----------
A. de Boer, M. S. van der Schoot, H. Bijl, "Mesh deformation based on radial basis function interpolation", Computers &
Structures 85 (2007) 784–795, Tables 1 and 2. H. Wendland, "Piecewise polynomial, positive definite and compactly
supported radial functions of minimal degree", Adv. Comput. Math. 4 (1995) 389–396. C. A. Micchelli, "Interpolation of
scattered data", Constr. Approx. 2 (1986) 11–22. R. Opfer, "Multiscale kernels", Adv. Comput. Math. 25 (2006) 357–380.
The thesis reproduces de Boer's tables as 2.1 and 2.2.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import mesh_motion_kernels as kernels
import numpy as np
from mesh_motion_protocol.errors import InvalidInput
from numpy.typing import ArrayLike

from mesh_motion_numerics.arrays import Floats

Definiteness = Literal["positive", "conditionally positive", "conditionally negative", "none"]

DEFAULT_BASIS = "wendland-c2"
MULTISCALE = "wendland-c2-multiscale"
"""Σ_k φ(2ᵏξ)/4ᵏ of Wendland's C2 function φ, k = 0 … 3. Its slope φ'(ξ)/ξ falls nearly with the logarithm of ξ from 1/8
to 1: a rotation is spread evenly over the distances from R/8 to R."""


@dataclass(frozen=True)
class Basis:
    """One basis function φ(ξ), ξ = r/R."""

    name: str  # as in the case file and on the wire
    number: int  # row of thesis Table 2.1 (1–8) or 2.2 (9–14); 0 if it is in neither
    #: formula, derivative: φ(ξ) and φ'(ξ); for compact functions on 0 ≤ ξ ≤ 1, zero beyond
    formula: str
    derivative: str
    compact: bool  # zero for r > R, thesis (2.7)
    #: Of the matrix φ(|x_i − x_j|) of distinct points in up to three dimensions; "conditionally" means on the vectors
    #: orthogonal to polynomials of degree < ``order``.
    definiteness: Definiteness
    order: int  # 0 for strictly definite functions
    gradient_at_centre: bool  # whether ∇φ exists at r = 0. Where it does not, no gradient is evaluated with this basis
    #: "support", "shape" (a length scale without which the function is undefined or its matrix near-singular) or "free"
    #: (the interpolant does not depend on it).
    radius_meaning: Literal["support", "shape", "free"]
    source: str
    unusable: str = ""  # why this row cannot be used; empty if it can be used

    @cached_property
    def code(self) -> int:
        """Number of the function in the compiled kernels."""
        return _CODES.index(self.name)

    @property
    def needs_polynomial(self) -> bool:
        """Whether the interpolation matrix is definite only together with a polynomial."""
        return self.order > 0


def _compact(number: int, name: str, formula: str, derivative: str, source: str, *, gradient: bool = True) -> Basis:
    return Basis(name, number, formula, derivative, True, "positive", 0, gradient, "support", source)


_WENDLAND = "thesis Table 2.1; Wendland 1995"
_DE_BOER = "thesis Table 2.1; de Boer et al. 2007, Table 1"
_TABLE_22 = "thesis Table 2.2; de Boer et al. 2007, Table 2"

#: In the order of kernels/src/interpolation/basis.h, which has their formulas.
BASES: dict[str, Basis] = {
    basis.name: basis
    for basis in (
        _compact(2, "wendland-c2", "(1-ξ)⁴(4ξ+1)", "-20ξ(1-ξ)³", _WENDLAND),
        _compact(
            0,
            MULTISCALE,
            "64/85 (φ(ξ)+φ(2ξ)/4+φ(4ξ)/16+φ(8ξ)/64), φ of wendland-c2",
            "32/85 (2φ'(ξ)+φ'(2ξ)+φ'(4ξ)/2+φ'(8ξ)/4), φ of wendland-c2",
            "Opfer 2006, with Wendland's C2 function",
        ),
        _compact(1, "wendland-c0", "(1-ξ)²", "-2(1-ξ)", _WENDLAND, gradient=False),
        _compact(3, "wendland-c4", "(1-ξ)⁶(35/3 ξ²+6ξ+1)", "-56/3 ξ(5ξ+1)(1-ξ)⁵", _WENDLAND),
        _compact(4, "wendland-c6", "(1-ξ)⁸(32ξ³+25ξ²+8ξ+1)", "-22ξ(16ξ²+7ξ+1)(1-ξ)⁷", _WENDLAND),
        _compact(5, "ctps-c0", "(1-ξ)⁵", "-5(1-ξ)⁴", _DE_BOER, gradient=False),
        _compact(
            6,
            "ctps-c1",
            "1+80/3 ξ²-40ξ³+15ξ⁴-8/3 ξ⁵+20ξ² log ξ",
            "ξ(220/3-120ξ+60ξ²-40/3 ξ³+40 log ξ)",
            f"{_DE_BOER}, with 80/3 where the thesis prints 20/3",
        ),
        _compact(7, "ctps-c2a", "1-30ξ²-10ξ³+45ξ⁴-6ξ⁵-60ξ³ log ξ", "ξ(-60-90ξ+180ξ²-30ξ³-180ξ log ξ)", _DE_BOER),
        _compact(8, "ctps-c2b", "1-20ξ²+80ξ³-45ξ⁴-16ξ⁵+60ξ⁴ log ξ", "ξ(-40+240ξ-120ξ²-80ξ³+240ξ² log ξ)", _DE_BOER),
        Basis("tps", 9, "ξ² log ξ", "ξ(2 log ξ+1)", False, "conditionally positive", 2, True, "free", _TABLE_22),
        Basis("mqb", 10, "√(1+ξ²)", "ξ/√(1+ξ²)", False, "conditionally negative", 1, True, "shape", _TABLE_22),
        Basis("imqb", 11, "1/√(1+ξ²)", "-ξ/(1+ξ²)^(3/2)", False, "positive", 0, True, "shape", _TABLE_22),
        Basis(
            "qb",
            12,
            "1+ξ²",
            "2ξ",
            False,
            "none",
            0,
            True,
            "shape",
            _TABLE_22,
            unusable="it is a polynomial, so that its matrix has rank d + 2 whatever the number of points",
        ),
        Basis("iqb", 13, "1/(1+ξ²)", "-2ξ/(1+ξ²)²", False, "positive", 0, True, "shape", _TABLE_22),
        Basis("gauss", 14, "exp(-ξ²)", "-2ξ exp(-ξ²)", False, "positive", 0, True, "shape", _TABLE_22),
    )
}
_CODES = tuple(BASES)


def basis_named(name: str, *, gradient: bool = False) -> Basis:
    """Look a basis up.

    Raises InvalidInput if the name is unknown, the basis unusable, or its gradient is needed and does not exist at a
    centre.

    Parameters
    ----------
    gradient : bool
        Whether gradients at centres will be needed.
    """
    usable = [basis for basis in BASES.values() if not basis.unusable]
    known = ", ".join(basis.name for basis in sorted(usable, key=lambda basis: basis.number or math.inf))
    if name not in BASES:
        raise InvalidInput(f"unknown basis {name!r}", hint=f"known are {known}")
    basis = BASES[name]
    if basis.unusable:
        raise InvalidInput(f"the basis {name!r} cannot interpolate: {basis.unusable}", hint=f"usable are {known}")
    if gradient:
        require_gradient(basis)
    return basis


def require_gradient(basis: Basis) -> None:
    """Raise :class:`InvalidInput` if the basis has no gradient at its centre."""
    if not basis.gradient_at_centre:
        raise InvalidInput(
            f"the basis {basis.name!r} has no gradient at a control point, but one is needed here",
            hint=f"take {DEFAULT_BASIS!r}",
        )


def checked_radius(radius: float | None, basis: Basis) -> float:
    """The support radius as a float, after checking it.

    ``None`` is accepted where the interpolant does not depend on it (TPS), and stands for 1. Raises InvalidInput if the
    radius is missing, not finite or not positive.
    """
    if radius is None:
        if basis.radius_meaning == "free":
            return 1.0
        meaning = {"support": "its support radius", "shape": "a shape parameter (the length scale R of ξ = r/R)"}
        raise InvalidInput(
            f"the basis {basis.name!r} needs {meaning[basis.radius_meaning]}", hint="give support_radius"
        )
    if not (math.isfinite(radius) and radius > 0.0):
        raise InvalidInput(f"expected a finite support radius > 0, got {radius!r}", hint="a length of the mesh's unit")
    return float(radius)


def values(basis: Basis, xi: ArrayLike) -> Floats:
    """φ(ξ) of an array of ξ ≥ 0, same shape."""
    out = np.array(xi, dtype=np.float64, order="C")
    kernels.map_phi(basis.code, out.reshape(-1))
    return out


def slopes(basis: Basis, xi: ArrayLike) -> Floats:
    """φ'(ξ)/ξ of an array of ξ ≥ 0, same shape; ``∇φ = slopes(ξ) (x − x_j) / R²``."""
    out = np.array(xi, dtype=np.float64, order="C")
    kernels.map_slope(basis.code, out.reshape(-1))
    return out
