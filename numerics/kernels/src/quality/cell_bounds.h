// Quality of cells from the Taylor polynomial of their group, and its lower bound given the remainder.
#pragma once

#include "view.h"

namespace mesh_motion {

/// `modelled` and `least` (2, m) have the rows size and skew, for cells with `nodes` (m, k) into points (n, d).
///
/// reference (m,), group (m,); middles (g, d), coefficients (g, d, c) and remainder (g,) of the groups' polynomials.
/// Cells of a group without a remainder (∞) get NaN and −∞.
///
/// If ∇S is known up to ε (operator norm) in a ball that holds the cell, an edge e of it is known up to ε |e|. So a
/// corner Jacobian with columns J_i is off by columns of length δ_i = ε |e_i| at most, and
///
///     |det − det J| ≤ Π (|J_i| + δ_i) − Π |J_i|                          (Hadamard, term by term)
///     |J W⁻¹|_F off by at most √(Σ δ_i²) |W⁻¹|                           (mean ratio)
///     Π of the column lengths at most Π (|J_i| + δ_i)                     (angles)
///
/// With the least determinants the largest f_k (cell_types.h) follow, hence the least skew n / Σ f_k; with the least
/// and the largest Σ α_k the least size. If a corner of a cell might be inverted, the cell has no bound (−∞).
void bounded_quality(Matrix<const double> points, Matrix<const Node> nodes, Vector<const double> reference,
                     Vector<const Index> group, Matrix<const double> middles, Cube<const double> coefficients,
                     Vector<const double> remainder, Matrix<double> modelled, Matrix<double> least);

}  // namespace mesh_motion
