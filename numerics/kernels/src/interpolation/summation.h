// Sums over centres: Σ_j w_j φ(|x − x_j|/R) and its gradient.
//
// Centres are sorted by the cells of a uniform grid (centres.py); coordinates and weights have one row for each
// component, so that the centres near a point are a few contiguous runs and every inner loop reads whole cache lines.
// One thread forms the sum at a point, in an order that depends only on the centres: bitwise the same for any
// number of threads, and for any set of points evaluated together. No array has the size points × centres.
#pragma once

#include <array>
#include <cmath>

#include "interpolation/basis.h"
#include "lanes.h"
#include "view.h"

namespace mesh_motion {

using Point = std::array<double, 3>;

/// Row i of (n, 3) points.
inline Point point_of(Matrix<const double> points, Index i) { return {points(i, 0), points(i, 1), points(i, 2)}; }

/// Sorted centres first … last − 1.
struct Run {
    Index first, last;
};

/// A few runs, without allocated memory.
template <std::size_t Most>
class FewRuns {
  public:
    void add(Index first, Index last) { runs_[count_++] = {first, last}; }
    Index size() const { return static_cast<Index>(count_); }
    const Run* begin() const { return runs_.data(); }
    const Run* end() const { return runs_.data() + count_; }

  private:
    std::array<Run, Most> runs_;
    std::size_t count_ = 0;
};

/// Number of rows of cells next to a point in three dimensions.
inline constexpr std::size_t max_runs = 9;

/// The grid of cells that finds sorted centres; for a compact basis its side is at least R.
struct CentreGrid {
    std::array<double, 3> origin;
    double inverse_side;         // 0 for a single cell
    std::array<Index, 3> shape;  // cells along each axis
    Vector<const Index> starts;  // (cells + 1,) first centre of each cell, x fastest

    CentreGrid(Vector<const double> lower, double inverse_side, Vector<const Index> cells, Vector<const Index> starts,
               Index centres)
        : inverse_side(inverse_side), starts(starts) {
        require(lower.size() == 3 && cells.size() == 3, "origin, shape: expected three numbers");
        Index count = 1;
        for (std::size_t axis = 0; axis < 3; ++axis) {
            origin[axis] = lower[axis], shape[axis] = cells[axis];
            require(0 < shape[axis] && count <= starts.size() / shape[axis], "starts: expected a number for each cell");
            count *= shape[axis];
        }
        require(cells_around() <= std::numeric_limits<std::int32_t>::max(), "shape: expected fewer cells than 2³¹");
        require(starts.size() == count + 1 && starts[0] == 0 && starts[count] == centres,
                "starts: expected a number for each cell, from 0 to the number of centres");
    }

    /// Cell number along one axis; places outside the grid get at most one past the neighbour of either end: −2 or
    /// n + 1.
    Index cell(const Point& x, std::size_t axis) const {
        const double place = std::floor((x[axis] - origin[axis]) * inverse_side);
        return static_cast<Index>(std::min(std::max(-2.0, place), static_cast<double>(shape[axis]) + 1.0));
    }

    /// Number of cells of the grid with one more on each side.
    Index cells_around() const { return (shape[0] + 2) * (shape[1] + 2) * (shape[2] + 2); }

    /// The cell of each of the points first … first + count − 1 (n, d), −1 if outside: equal numbers have equal runs.
    /// Computed axis by axis, so that the loops become vector code.
    template <int d>
    void numbers(Matrix<const double> points, Index first, Index count, std::int32_t* __restrict found) const {
        const double* __restrict x = points.data() + first * d;
        std::fill_n(found, count, 0);
        for (std::size_t axis = 3; axis-- > 0;) {
            const double low = origin[axis], end = static_cast<double>(shape[axis] + 2);
            const auto cells = static_cast<std::int32_t>(shape[axis] + 2);
            for (Index i = 0; i < count; ++i) {
                // rounding differs from cell(): next to a cell's side the runs of both cells contain all near centres
                const double place = ((axis < d ? x[d * i + axis] : 0.0) - low) * inverse_side + 1.0;
                const bool along = (0.0 <= place) & (place < end);
                const std::int32_t number = found[i] * cells + static_cast<std::int32_t>(along ? place : 0.0);
                found[i] = along & (found[i] >= 0) ? number : -1;
            }
        }
    }

    /// The same for one point.
    Index number(const Point& x) const {
        std::int32_t found;
        numbers<3>({x.data(), {1, 3}}, 0, 1, &found);
        return found;
    }

    /// The centres within one cell of a point: at most nine runs, because cells that follow along x are neighbours in
    /// memory.
    FewRuns<max_runs> centre_runs(const Point& x) const {
        FewRuns<max_runs> runs;
        const auto low = [&](std::size_t axis) { return std::max<Index>(cell(x, axis) - 1, 0); };
        const auto high = [&](std::size_t axis) { return std::min(cell(x, axis) + 1, shape[axis] - 1); };
        const Index x_low = low(0), x_high = high(0), y_low = low(1), y_high = high(1), z_high = high(2);
        if (x_low > x_high) return runs;
        for (Index z = low(2); z <= z_high; ++z)
            for (Index y = y_low; y <= y_high; ++y) {
                const Index row = (z * shape[1] + y) * shape[0];
                const Index first = starts[row + x_low], last = starts[row + x_high + 1];
                require(0 <= first && last <= starts[starts.size() - 1], "starts: expected numbers that do not fall");
                if (last > first) runs.add(first, last);
            }
        return runs;
    }

    /// Rough number of centres that a sum visits at a point, as if all cells had the same number.
    double visited() const {
        const auto centres = static_cast<double>(starts[starts.size() - 1]);
        return std::min(centres, std::max(64.0, 27.0 * centres / static_cast<double>(starts.size() - 1)));
    }
};

/// Number of centres in a tile: its φ (or the three components of ∇φ) and the weights stay in the first-level cache.
inline constexpr Index tile_size = 256;

/// Rows of coordinates or weights, as plain pointers to rows of equal length.
template <std::size_t N>
std::array<const double*, N> rows_of(Matrix<const double> rows) {
    std::array<const double*, N> pointers;
    for (std::size_t c = 0; c < N; ++c) pointers[c] = rows[static_cast<Index>(c)].data();
    return pointers;
}

/// φ(|x − x_j|/R) of every centre j of a tile.
template <class Basis>
inline void fill_tile(const Point& x, Index first, Index last, Matrix<const double> centres, double inverse_radius,
                      std::array<double, tile_size>& values) {
    const auto [cx, cy, cz] = rows_of<3>(centres);
    for (Index j = first; j < last; ++j) {
        const double dx = x[0] - cx[j], dy = x[1] - cy[j], dz = x[2] - cz[j];
        const double xi = std::sqrt(dx * dx + dy * dy + dz * dz) * inverse_radius;
        values[static_cast<std::size_t>(j - first)] = Basis::phi(xi);
    }
}

/// Whether displacements and their gradients use one loop without a tile: for the bases of nearly all interpolants.
template <class Basis>
inline constexpr bool fused = std::is_same_v<Basis, WendlandC2> || std::is_same_v<Basis, WendlandC2Multiscale>;

/// sum_over for K components, whose products take no time besides the square root: 0.6 ns a pair.
template <class Basis, std::size_t K, class Ranges>
inline void few_sums(const Point& x, const Ranges& runs, Matrix<const double> centres, Matrix<const double> weights,
                     double inverse_radius, Vector<double> out) {
    const auto [cx, cy, cz] = rows_of<3>(centres);
    const auto w = rows_of<K>(weights);
    std::array<Lanes, K> sums;
    const auto add = [&](Index j, Index l) {
        const double dx = x[0] - cx[j], dy = x[1] - cy[j], dz = x[2] - cz[j];
        const double value = Basis::phi(std::sqrt(dx * dx + dy * dy + dz * dz) * inverse_radius);
        for (std::size_t c = 0; c < K; ++c) sums[c].part[l] += value * w[c][j];
    };
    for (const auto& [first, last] : runs) {
        Index j = first;
        for (; j + lanes <= last; j += lanes)
            for (Index l = 0; l < lanes; ++l) add(j + l, l);
        for (Index l = 0; j < last; ++j, ++l) add(j, l);
    }
    std::transform(sums.begin(), sums.end(), out.begin(), [](const Lanes& sum) { return sum.total(); });
}

/// out[c] = Σ_j weights[c, j] φ(|x − centres[:, j]|/R) over the centres j of some runs.
///
/// Any range of Run, (3, n) centres, (k, n) weights, (k,) out. The distances and φ are computed once for many columns.
template <class Basis, class Ranges>
inline void sum_over(const Point& x, const Ranges& runs, Matrix<const double> centres, Matrix<const double> weights,
                     double inverse_radius, Vector<double> out) {
    if constexpr (fused<Basis>) {
        switch (out.size()) {
            case 1: return few_sums<Basis, 1>(x, runs, centres, weights, inverse_radius, out);
            case 2: return few_sums<Basis, 2>(x, runs, centres, weights, inverse_radius, out);
            case 3: return few_sums<Basis, 3>(x, runs, centres, weights, inverse_radius, out);
        }
    }
    std::fill(out.begin(), out.end(), 0.0);
    std::array<double, tile_size> values;
    for (const auto& [begin, end] : runs)
        for (Index first = begin; first < end; first += tile_size) {
            const Index last = std::min(first + tile_size, end);
            fill_tile<Basis>(x, first, last, centres, inverse_radius, values);
            for (Index c = 0; c < out.size(); ++c) {
                const double* w = weights[c].data();
                out[c] += sum_in_lanes(first, last, [&](Index j) {
                    return values[static_cast<std::size_t>(j - first)] * w[j];
                });
            }
        }
}

/// out[i, c] = Σ_j weights[c, j] φ(|points[i] − centres[:, j]| / R).
///
/// (n, 3) points, (3, nc) centres sorted by cells, (k, nc) weights in the same order, the grid as in CentreGrid, (n, k)
/// out.
void sum_values(int code, Matrix<const double> points, Matrix<const double> centres, Matrix<const double> weights,
                double inverse_radius, Vector<const double> origin, double inverse_side, Vector<const Index> shape,
                Vector<const Index> starts, Matrix<double> out);

/// out[i, c, m] = Σ_j weights[c, j] ∂φ/∂x_m; arguments as in sum_values, (n, k, d) out.
void sum_gradients(int code, Matrix<const double> points, Matrix<const double> centres, Matrix<const double> weights,
                   double inverse_radius, Vector<const double> origin, double inverse_side, Vector<const Index> shape,
                   Vector<const Index> starts, Cube<double> out);

}  // namespace mesh_motion
