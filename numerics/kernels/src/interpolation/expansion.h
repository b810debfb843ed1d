// An interpolant around points: derivatives up to the third, and a bound on the distance to its Taylor polynomial.
//
// With y = x − x_j, ξ = |y|/R and ψ_k(ξ) = (1/ξ d/dξ)^k φ(ξ) the derivatives of a radial function are
//     ∂_a φ   = ψ_1 y_a / R²
//     ∂_ab φ  = ψ_1 δ_ab / R² + ψ_2 y_a y_b / R⁴
//     ∂_abc φ = ψ_2 (δ_ab y_c + δ_ac y_b + δ_bc y_a) / R⁴ + ψ_3 y_a y_b y_c / R⁶.
#pragma once

#include "view.h"

namespace mesh_motion {

/// out[g, i, c] = Σ_j weights[i, j] · derivative c of φ at a point: first those along a, then ab, then abc with
/// a ≤ b ≤ c.
///
/// (g, 3) points, (3, nc) sorted centres, (k, nc) weights, (3, N + 1) derivatives with ψ_k = ξ^(−2k) Σ_n
/// derivatives[k − 1, n] ξⁿ, the grid as in CentreGrid, (g, k, 3 | 9 | 19) out in one, two or three dimensions.
void expand(Matrix<const double> points, Matrix<const double> centres, Matrix<const double> weights,
            double inverse_radius, Matrix<const double> derivatives, Vector<const double> origin, double inverse_side,
            Vector<const Index> shape, Vector<const Index> starts, Cube<double> out);

/// The bound of remainder.py for balls (g, d) and (g,), from clusters of control points no farther than near radii.
///
/// Places (m, d), reaches (m,) and weights (m,) are the clusters' centres, radii and sums of |γ|; table (2, steps + 1)
/// has E_3 and E_4 over ξ from 0 to 1; out (g,).
void sum_remainders(Matrix<const double> middles, Vector<const double> radii, Matrix<const double> places,
                    Vector<const double> reaches, Vector<const double> weights, Matrix<const double> table,
                    double inverse_radius, double near, Vector<double> out);

}  // namespace mesh_motion
