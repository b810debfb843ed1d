// The distortion of a corner simplex and its curvature, for eight corners side by side; shared by distortion.cpp and
// cells.cpp.
//
// A corner with the edges A (columns) has the Jacobian J = A P from its ideal, τ = det J and q = |J|²_F.
#pragma once

#include "correction/small_matrices.h"
#include "interpolation/basis.h"

namespace mesh_motion {

/// m and ε of distortion.h, and a, the weight of the size.
struct SizeLaw {
    double m, epsilon, a;
};

/// (a/m) log cosh(m log τ) for τ > 0, with log τ.
inline Pack log_cosh(Pack log_tau, const SizeLaw& law) {
    const Pack x = size_of(law.m * log_tau);
    return law.a / law.m * (x + each(logarithm, 0.5 + 0.5 * each(exponential, -2.0 * x)));
}

/// Its first two derivatives with respect to log τ: a tanh, a m (1 − tanh²).
inline std::pair<Pack, Pack> log_cosh_slopes(Pack log_tau, const SizeLaw& law) {
    const Pack y = law.m * log_tau, e = each(exponential, -2.0 * size_of(y)), sum = 1.0 + e;
    const Pack tanh = (1.0 - e) / sum;
    return {law.a * (y < 0.0 ? -tanh : tanh), 4.0 * law.a * law.m * e / (sum * sum)};
}

/// Edges from node 0 of a simplex, as columns; node(lane, place) is the row number of a point.
template <int d, class Node>
inline Small<d> edges(Matrix<const double> points, Node&& node) {
    std::array<std::array<Pack, d>, d + 1> x;
#pragma GCC unroll 4
    for (int place = 0; place <= d; ++place) {
        std::array<const double*, lanes> row;
        for (int l = 0; l < lanes; ++l) row[l] = points.data() + Index{node(l, place)} * d;
#pragma GCC unroll 3
        for (int i = 0; i < d; ++i) x[place][i] = gathered([&](int l) { return row[l][i]; });
    }
    Small<d> a;
    for (int i = 0; i < d; ++i)
        for (int j = 0; j < d; ++j) a[i][j] = x[j + 1][i] - x[0][i];
    return a;
}

/// The maps P of the corners, one in each lane.
template <int d, class Corner>
inline Small<d> ideals_of(Cube<const double> ideals, Corner&& corner) {
    Small<d> p;
    for (int i = 0; i < d; ++i)
        for (int k = 0; k < d; ++k)
            p[i][k] = gathered([&](int l) { return ideals.data()[(corner(l) * d + i) * d + k]; });
    return p;
}

/// In one dimension there is no shape; the number in place of 1/q is 0.
template <int d>
inline Pack inverse_square(const Small<d>& j) {
    return d == 1 ? Pack{} : 1.0 / square<d>(j);
}

/// The Hessian of one corner with respect to J, in the singular values of J = U S Vᵀ:
///
///   M_ij = ω (2 δ_ij/q − 4 s_i s_j/q²) + h2 t_i t_j + h1 t_ij + p ℓ_i ℓ_j,     ℓ_i = 2 s_i/q + slope t_i
struct Terms {
    Pack shape, h1, h2, p, slope;
};

/// The positive part of a corner's Hessian, times a weight, at its edges: the lower half of the (d², d²) matrix with
/// row and column j d + i of the coordinate i of the edge j.
///
/// The stretches u_i v_iᵀ couple through M, with t_i = Π_{k≠i} s_k and t_ij = 1 (2D), s_k (3D), 0 for i = j. Every pair
/// (i, j) has one rotation-like and one shear-like mode (cf. Smith, de Goes & Kim, Analytic eigensystems for isotropic
/// distortion energies, ACM TOG 38, 2019): (u_i v_jᵀ ∓ u_j v_iᵀ)/√2 with λ = 2 ω/q ± h1 t_ij. Negative λ are dropped,
/// unless the exact Hessian is wanted.
template <int d>
using Curvature = std::array<std::array<Pack, d * d>, d * d>;

template <int d, bool exact = false>
inline void curvature(const Small<d>& jacobian, Pack per_q, const Small<d>& ideal, const Terms& law, Pack weight,
                      Curvature<d>& total) {
    const auto [u, v, s] = signed_svd<d>(jacobian);
    std::array<Pack, d> t, l;
    for (int i = 0; i < d; ++i) {
        t[i] = all(1.0);
        for (int k = 0; k < d; ++k)
            if (k != i) t[i] *= s[k];
        l[i] = 2.0 * per_q * s[i] + law.slope * t[i];
    }
    Small<d> stretch, alike, crossed;  // both modes of each pair, transformed back to the basis u_i v_jᵀ, u_j v_iᵀ
    const Pack half = law.shape * per_q;
    for (int i = 0; i < d; ++i)
        for (int j = 0; j < d; ++j) {
            const Pack t_ij = i == j ? Pack{} : d == 3 ? law.h1 * s[(6 - i - j) % 3] : law.h1;
            stretch[i][j] = (law.h2 * t[i] * t[j] - 4.0 * half * per_q * s[i] * s[j]) + (t_ij + law.p * l[i] * l[j]);
            if (i == j) stretch[i][j] += 2.0 * half;
            Pack rotation = half + 0.5 * t_ij, shear = half - 0.5 * t_ij;
            if constexpr (!exact) rotation = larger(rotation, Pack{}), shear = larger(shear, Pack{});
            alike[i][j] = rotation + shear;
            crossed[i][j] = shear - rotation;
        }
    if constexpr (!exact) project<d>(stretch);
    const Small<d> z = product<d>(ideal, v);  // the right singular vectors at the edges
    for (int j = 0; j < d; ++j)
        for (int c = 0; c <= j; ++c) {
            Small<d> part{};  // coupling between the edges j and c, in the basis of the left singular vectors
            for (int i = 0; i < d; ++i)
                for (int k = 0; k < d; ++k) {
                    part[i][k] += z[j][i] * z[c][k] * stretch[i][k];
                    if (i == k) continue;
                    part[i][i] += z[j][k] * z[c][k] * alike[i][k];
                    part[i][k] += z[j][k] * z[c][i] * crossed[i][k];
                }
            const Small<d> whole = product_transposed<d>(product<d>(u, part), u);
            for (int a = 0; a < d; ++a)
                for (int b = 0; b < d; ++b) total[j * d + a][c * d + b] = weight * whole[a][b];
        }
}

}  // namespace mesh_motion
