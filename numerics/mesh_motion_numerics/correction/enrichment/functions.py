"""The enrichment functions H1, H2, H3 around an enrichment point, thesis (4.5)–(4.8), (5.1)–(5.3), (6.1).

With φ Wendland's C2 function of r/R_l and ρ = x − x_c, component m of each is

- ``H1_m = ρ_m φ``, the thesis' choice: linear near its point, 0 from R_l on;
- ``H2_m = ∂φ/∂x_m = −20 ρ_m (R_l − r)³ / R_l⁵``;
- ``H3_m = ∂φ/∂x_m φ``.

All are 0 at their point and beyond R_l. (4.7) as printed has ρ² for ρ and R_l − r³ for (R_l − r)³; the figures and
Table 4.1 of the thesis use the forms given here.
"""

from collections.abc import Callable

import numpy as np

from mesh_motion_numerics.arrays import Floats


def _h1(xi: Floats, _radius: float) -> tuple[Floats, Floats]:
    """H1_m = ρ_m f(ξ): f and f'(ξ)/ξ."""
    t = np.maximum(0.0, 1.0 - xi)
    return t**4 * (4.0 * xi + 1.0), -20.0 * t**3


def _h2(xi: Floats, radius: float) -> tuple[Floats, Floats]:
    """H2_m = ρ_m f(ξ), f = −20 (1 − ξ)³ / R_l²; f' / ξ is multiplied by a vanishing ρ_m ρ_j at ξ = 0."""
    t = np.maximum(0.0, 1.0 - xi)
    return -20.0 * t**3 / radius**2, 60.0 * t**2 / np.where(xi > 0.0, xi, 1.0) / radius**2


def _h3(xi: Floats, radius: float) -> tuple[Floats, Floats]:
    """H3 = H2 φ: the product rule on both factors."""
    f1, slope1 = _h1(xi, radius)
    f2, slope2 = _h2(xi, radius)
    return f2 * f1, slope2 * f1 + f2 * slope1


#: Name → (f, f'/ξ) of ``H_m = ρ_m f(ξ)``, as functions of ξ = r/R_l and R_l.
ENRICHMENT_FUNCTIONS: dict[str, Callable[[Floats, float], tuple[Floats, Floats]]] = {"H1": _h1, "H2": _h2, "H3": _h3}


def values(kind: str, points: Floats, centre: Floats, radius: float) -> Floats:
    """The d components of an enrichment function.

    Parameters
    ----------
    kind : {"H1", "H2", "H3"}
    points : (n, d) array, mesh length unit
    centre : (d,) array, mesh length unit
        x_c.
    radius : float, mesh length unit
        R_l.

    Returns
    -------
    (n, d) array
        ``[i, m] = H_m(points[i])``.
    """
    rho, f, _ = _radial(kind, points, centre, radius)
    return rho * f[:, None]


def gradients(kind: str, points: Floats, centre: Floats, radius: float) -> Floats:
    """Gradients of the d components: ``f δ_mj + ρ_m ρ_j f'/(ξ R_l²)``.

    Parameters as in :func:`values`.

    Returns
    -------
    (n, d, d) array
        ``[i, m, j] = ∂H_m/∂x_j (points[i])``.
    """
    rho, f, slope = _radial(kind, points, centre, radius)
    out = rho[:, :, None] * rho[:, None, :] * (slope / radius**2)[:, None, None]
    diagonal = np.arange(rho.shape[1])
    out[:, diagonal, diagonal] += f[:, None]
    return out


def slope_at_point(kind: str, radius: float) -> float:
    """c of thesis (5.17): at the enrichment point ∇H is c times the identity; 1 for H1, −20/R_l² for H2 and H3."""
    _, f, _ = _radial(kind, np.zeros((1, 1)), np.zeros(1), radius)
    return float(f[0])


def _radial(kind: str, points: Floats, centre: Floats, radius: float) -> tuple[Floats, Floats, Floats]:
    """(n, d) ρ, (n,) f(ξ), (n,) f'(ξ)/ξ."""
    rho = np.asarray(points, dtype=np.float64) - np.asarray(centre, dtype=np.float64)
    xi = np.sqrt(np.sum(rho * rho, axis=1)) / radius
    f, slope = ENRICHMENT_FUNCTIONS[kind](xi, radius)
    return rho, f, slope
