// Polynomials given by their values at Chebyshev points, evaluated at other points along one axis at a time.
//
// Values are (p^d, k), x slowest, components fastest.
#pragma once

#include "view.h"

namespace mesh_motion {

/// Highest order: number of points of a polynomial along an axis.
inline constexpr int most_order = 10;

/// Point i of `order` Chebyshev points of the first kind, cos((2i + 1)π / (2 order)).
double chebyshev_place(int order, int i);

/// The Lagrange functions of the Chebyshev points at u in [−1, 1]; entries from `order` on are not set.
void lagrange_functions(double u, int order, std::array<double, most_order>& out);

/// Interpolation along an axis: [i][x] is Lagrange function i at place x.
using Resampling = std::array<std::array<double, 16>, most_order>;

/// Number of doubles that add_resampled needs for polynomials of p points along an axis, evaluated at q places.
template <int D>
constexpr Index resampling_room(Index q, Index k) {
    return D == 1 ? 0 : D == 2 ? q * k : (q * q + q) * k;
}

/// Evaluates the polynomial with values (p^D, k) at places q[0] × …, with a matrix for each axis, and adds it to out.
/// The trailing axes of each slab come first, so that the longest sums, along x, are over contiguous rows.
template <int D>
void add_resampled(const double* values, int p, const Resampling* const* matrices, const int* q, Index k,
                   double* __restrict out, double* __restrict room) {
    const Resampling& matrix = **matrices;
    if constexpr (D == 1) {
        for (int i = 0; i < p; ++i)
            for (int x = 0; x < *q; ++x)
                for (Index c = 0; c < k; ++c) out[x * k + c] += matrix[i][x] * values[i * k + c];
    } else {
        const Index slab = D == 2 ? p * k : Index{p} * p * k, size = (D == 2 ? q[1] : Index{q[1]} * q[2]) * k;
        for (int i = 0; i < p; ++i) {
            std::fill(room, room + size, 0.0);
            add_resampled<D - 1>(values + i * slab, p, matrices + 1, q + 1, k, room, room + size);
            for (int x = 0; x < *q; ++x) {
                const double weight = matrix[i][x];
                for (Index r = 0; r < size; ++r) out[x * size + r] += weight * room[r];
            }
        }
    }
}

}  // namespace mesh_motion
