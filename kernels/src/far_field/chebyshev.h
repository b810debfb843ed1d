// Polynomials in boxes by their values at Chebyshev points: from parent to child, to higher orders, and to the points.
//
// A polynomial of p points an axis is exact for those of fewer, so nothing is lost on the way down the tree: the
// polynomials of a box and of those above it end as one, which is evaluated at the points of a leaf.
//
// Values are (p^d, k), x slowest, components fastest.
#pragma once

#include "view.h"

namespace mesh_motion {

/// Highest order: points an axis of a polynomial.
inline constexpr int most_order = 10;

/// Point i of `order` Chebyshev points of the first kind, cos((2i + 1)π / (2 order)).
double chebyshev_place(int order, int i);

/// The Lagrange functions of the Chebyshev points at u in [−1, 1]; those from `order` on are left out.
void lagrange_functions(double u, int order, std::array<double, most_order>& out);

/// Interpolation along an axis: [i][x] is Lagrange function i at place x.
using Resampling = std::array<std::array<double, 16>, most_order>;

/// Numbers that add_resampled needs for polynomials of p points an axis, taken to q places.
template <int D>
constexpr Index resampling_room(Index q, Index k) {
    return D == 1 ? 0 : D == 2 ? q * k : (q * q + q) * k;
}

/// Adds the polynomial with values (p^D, k) at places q[0] × … to out, by each axis' matrix: the trailing axes of each
/// slab first, so that the longest sums, along x, are over contiguous rows.
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

/// The Chebyshev points of boxes box (g), order^d each, into out (r, 3) from row starts[g] (g + 1) on; low, high (b, 3)
/// are the boxes' corners. A side without length has its points at its middle.
void box_points(Vector<const Index> box, Vector<const Index> order, Vector<const Index> starts, int d,
                Matrix<const double> low, Matrix<const double> high, Matrix<double> out);

/// The polynomial of every box: those of its groups and its parent's.
///
/// levels (l + 1), parent (b), low and high (b, 3) of the tree; order (b): at least the parent's and those of the box's
/// groups, 0 where there is no polynomial; starts (b + 1): first entry of each box in values (v), which are filled.
/// first_group (b + 1), group_order (g), group_start (g + 1), group_values (r, k): of each box the groups, of these the
/// order, and the values at the points of box_points.
void carry_down(Vector<const Index> levels, Vector<const Index> parent, Matrix<const double> low,
                Matrix<const double> high, Vector<const Index> order, Vector<const Index> starts,
                Vector<const Index> first_group, Vector<const Index> group_order, Vector<const Index> group_start,
                Matrix<const double> group_values, int d, Vector<double> values);

/// Adds the polynomials of the leaves (l) to out (n, k) at their sorted points (n, 3); the rest as above.
void add_polynomials(Vector<const Index> leaves, Matrix<const Index> points_of, Matrix<const double> points,
                     Matrix<const double> low, Matrix<const double> high, Vector<const Index> order,
                     Vector<const Index> starts, Vector<const double> values, int d, Matrix<double> out);

}  // namespace mesh_motion
