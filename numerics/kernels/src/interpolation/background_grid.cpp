#include "interpolation/background_grid.h"

#include "parallel.h"

namespace mesh_motion {
namespace {

constexpr Index block = 512;  // number of places in one task

/// Lagrange weights at t in [0, 1] between the two middle points.
std::array<double, 4> lagrange_weights(double t, int width) {
    if (width == 2) return {1.0 - t, t};
    return {-t * (t - 1.0) * (t - 2.0) / 6.0, (t + 1.0) * (t - 1.0) * (t - 2.0) / 2.0,
            -(t + 1.0) * t * (t - 2.0) / 2.0, (t + 1.0) * t * (t - 1.0) / 6.0};
}

/// The grid points around a place: the first one and their number along each axis, and their weights.
struct Stencil {
    std::array<Index, 3> first{}, count{1, 1, 1};
    std::array<std::array<double, 4>, 3> weight{{{1.0}, {1.0}, {1.0}}};

    Stencil(Matrix<const double> places, Index i, Vector<const Index> shape, int width) {
        for (Index axis = 0; axis < 3; ++axis) {
            if (shape[axis] == 1) continue;
            const auto last = static_cast<double>(shape[axis] - 1);
            const double place = places(i, axis) > 0.0 ? std::min(places(i, axis), last) : 0.0;
            const auto cell = static_cast<Index>(place);
            count[axis] = width;
            first[axis] = std::min(std::max<Index>(cell - (width / 2 - 1), 0), shape[axis] - width);
            weight[axis] = lagrange_weights(place - static_cast<double>(cell), width);
        }
    }

    /// Calls f(flat grid index, weight) for each point.
    template <class F>
    void for_points(Vector<const Index> shape, F&& f) const {
        for (Index x = 0; x < count[0]; ++x)
            for (Index y = 0; y < count[1]; ++y)
                for (Index z = 0; z < count[2]; ++z)
                    f(((first[0] + x) * shape[1] + first[1] + y) * shape[2] + first[2] + z,
                      weight[0][x] * weight[1][y] * weight[2][z]);
    }
};

void check(Matrix<const double> places, Vector<const Index> shape, int width, Index points) {
    require(places.shape(1) == 3 && shape.size() == 3, "places, shape: expected (n, 3), (3,)");
    require(width == 2 || width == 4, "width: expected 2 or 4");
    Index count = 1;
    for (Index n : shape) {
        require((n == 1 || n >= width) && n <= points / count, "shape: expected 1 or at least the width an axis");
        count *= n;
    }
    require(count == points, "marked, rows: expected an entry for each grid point");
}

}  // namespace

void mark_stencils(Matrix<const double> places, Vector<const Index> shape, int width, Vector<bool> marked) {
    check(places, shape, width, marked.size());
    for (Index i = 0; i < places.shape(0); ++i)
        Stencil(places, i, shape, width).for_points(shape, [&](Index flat, double) { marked[flat] = true; });
}

void interpolate_on_grid(Matrix<const double> places, Vector<const Index> shape, int width, Vector<const Index> rows,
                         Matrix<const double> values, Matrix<double> out) {
    check(places, shape, width, rows.size());
    const Index k = values.shape(1);
    require(out.shape(0) == places.shape(0) && out.shape(1) == k, "out: expected (n, k)");
    if (places.shape(0) == 0) return;
    for (Index row : rows) require(0 <= row && row < values.shape(0), "rows: expected numbers of values");
    for_ranges(places.shape(0), block, [&](Index begin, Index end) {
        for (Index i = begin; i < end; ++i) {
            const auto total = out[i];
            std::fill(total.begin(), total.end(), 0.0);
            Stencil(places, i, shape, width).for_points(shape, [&](Index flat, double weight) {
                for (Index c = 0; c < k; ++c) total[c] += weight * values(rows[flat], c);
            });
        }
    });
}

}  // namespace mesh_motion
