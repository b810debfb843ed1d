// The distortion ℓ of corner simplices, its p-mean, and the derivatives with respect to the nodes.
//
// With the Jacobian J = A P of corner.h, τ = det J and q = |J|²_F
//
//   ℓ   = log q − log d − (2/d) log τ + (a/m) log cosh(m log τ)               ε = 0, τ > 0
//   ℓ_ε = log q − log d − (2/d + a) log χ + a log((1 + τ²)/2)                 untangling, χ = (τ + √(τ² + ε²))/2
//
// and, for a corner whose angles count, plus φ of quality/angle_law.h. In 1D the first three terms cancel.
// points (n, d), corners (c, d + 1): the nodes of each corner, ideals (c, d, d): P, angles (c, or 0 where none counts):
// the obliqueness Σ log |a_k| − log |det A| at rest, negative where the angles do not count.
#pragma once

#include "view.h"

namespace mesh_motion {

/// ideals (c, d, d) = the inverse of the edges at rest, and oblique (c) their Σ log |a_k| − log |det A|; where det A is at
/// most `least` times Π |a_k|, the ideal keeps its value and oblique is −1.
void corner_maps(Matrix<const double> reference, Matrix<const std::int32_t> corners, double least, Cube<double> ideals,
                 Vector<double> oblique);

/// values (c) = ℓ, plus offset (c; or 0 entries for none); inf where ℓ is not a number or τ violates ε = 0.
void distortions(Matrix<const double> points, Matrix<const std::int32_t> corners, Cube<const double> ideals,
                 Vector<const double> angles, Vector<const double> offset, double m, double epsilon, double a,
                 Vector<double> values);

/// Returns E = max ℓ + (1/p) log mean exp(p (ℓ − max ℓ)) of values ℓ, and replaces them by the weights softmax(p ℓ). If
/// a value is not finite, returns inf and leaves the values unchanged.
double p_mean(Vector<double> values, double p);

/// shares (c, d + 1, d) = w dℓ/dx of the nodes of each corner; 0 where w is negligible.
void distortion_gradients(Matrix<const double> points, Matrix<const std::int32_t> corners, Cube<const double> ideals,
                          Vector<const double> angles, Vector<const double> weights, double m, double epsilon,
                          double a, Cube<double> shares);

/// τ (c).
void determinants(Matrix<const double> points, Matrix<const std::int32_t> corners, Cube<const double> ideals,
                  Vector<double> taus);

/// blocks (c, d², d²) = w₁ ∇∇ℓ + w₂ ∇ℓ ∇ℓᵀ with the weights first and second (c): the Hessian of a function of ℓ with
/// these derivatives, exact or with the positive part of ∇∇ℓ; the order is that of corner_blocks.
void corner_hessians(Matrix<const double> points, Matrix<const std::int32_t> corners, Cube<const double> ideals,
                     Vector<const double> angles, Vector<const double> first, Vector<const double> second, double m,
                     double a, bool exact, Cube<double> blocks);

/// blocks (c, d², d²) = (w + floor) times the positive part of the Hessian of ℓ and of the p-mean's rank-one term, of
/// the corners whose weight is at least least_weight: [j d + k, a d + b] couples the coordinate a of edge j with b of
/// edge k.
void corner_blocks(Matrix<const double> points, Matrix<const std::int32_t> corners, Cube<const double> ideals,
                   Vector<const double> weights, double floor, double least_weight, double p, double m, double epsilon,
                   double a, Cube<float> blocks);

}  // namespace mesh_motion
