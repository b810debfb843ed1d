// The distortion L of whole cells of one type, and its derivatives with respect to their nodes.
//
//   L = log mean_k f_k + (a/m) log cosh(m log τ)          τ = Σ α_k / Σ α_k⁰,  α_k > 0 at every corner k
//
// Every function takes points (n, d), nodes (m, k), corners (c, d + 1) in numbers of the cell's own nodes, ideals
// (1 or m, d, d), references (m): Σ α_k⁰, and sine. With the Jacobian J = A P of a corner, q = |J|²_F:
//
//   sine = 0   the mean ratio f = q/d (1 / det J)^(2/d), P from ideals, of determinant 1
//   sine = w   angles, f = (w Π |A_i| / det A)^(2/d), the smallest mean ratio over all diagonal P, which
//              P = diag(1/|A_i|) has
//
// In the second case P is constant while f is differentiated: value and gradient are exact, the curvature is a
// majorant's. With ω_k = f_k / Σ f, β_k = α_k / Σ α, z = (a/m) log cosh(m log τ) and derivatives of z with respect to
// log τ
//
//   ∇L = Σ_k [ω_k 2 J/q + h1_k cof J] Pᵀ,     h1_k = (z' β_k − (2/d) ω_k) / det J
//   H  = w { Σ_k [corner k]₊ + [(p − 1) g gᵀ + p z' (g nᵀ + n gᵀ) + (p z'² + z″ − z') n nᵀ]₊ }
//
// where g and n are the gradients of log mean f and of log τ, and a corner's part has its own rank-one term ω_k.
//
// Relative to the cells at rest, offset (m; otherwise empty) is the logarithm of their skew, and L has for the shape
// F = log mean f + offset only what it lost:
//
//   F₊ = log(1 + exp(p F)) / p      ∇F₊ = ∇F / (1 + exp(−p F))      the curvature stays that of L with F
#pragma once

#include "view.h"

namespace mesh_motion {

/// values (m) = L; inf where a corner is not positive.
void cell_distortions(Matrix<const double> points, Matrix<const std::int32_t> nodes, Matrix<const Index> corners,
                      Cube<const double> ideals, double sine, Vector<const double> references, double m, double a,
                      Vector<const double> offset, double p, Vector<double> values);

/// shares (m, k, d) = w dL/dx of each cell's nodes.
void cell_gradients(Matrix<const double> points, Matrix<const std::int32_t> nodes, Matrix<const Index> corners,
                    Cube<const double> ideals, double sine, Vector<const double> references, double m, double a,
                    Vector<const double> offset, double p, Vector<const double> weights, Cube<double> shares);

/// blocks (m, k², d²) = H with the weights w + floor, of the cells whose weight is at least least_weight: [a k + b]
/// couples the nodes a and b.
void cell_blocks(Matrix<const double> points, Matrix<const std::int32_t> nodes, Matrix<const Index> corners,
                 Cube<const double> ideals, double sine, Vector<const double> references, double m, double a,
                 Vector<const double> offset, double p, Vector<const double> weights, double floor,
                 double least_weight, Cube<float> blocks);

}  // namespace mesh_motion
