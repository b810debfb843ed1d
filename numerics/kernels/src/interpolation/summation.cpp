#include "interpolation/summation.h"

#include "parallel.h"

namespace mesh_motion {
namespace {

/// Number of points in a block: some 10⁵ pairs.
Index points_of_block(double visited, Index columns) {
    const double work = (visited + 64.0) * (1.0 + static_cast<double>(columns) / 8.0);
    return std::max<Index>(1, static_cast<Index>(1e5 / work));
}

void check_sums(Matrix<const double> points, Matrix<const double> centres, Matrix<const double> weights, Index rows,
                Index columns) {
    require(points.shape(1) == 3 && centres.shape(0) == 3, "points, centres: expected shapes (n, 3) and (3, nc)");
    require(weights.shape(1) == centres.shape(1), "weights: expected a column for each centre");
    require(rows == points.shape(0) && columns == weights.shape(0), "out: expected shape (n, k) or (n, k, d)");
}

/// gradients_over for as many components as axes. Without an array over the axes the compiler uses full vectors.
template <class Basis, std::size_t D>
void few_gradients(const Point& x, const FewRuns<max_runs>& runs, Matrix<const double> centres,
                   Matrix<const double> weights, double inverse_radius, Matrix<double> out) {
    const auto [cx, cy, cz] = rows_of<3>(centres);
    const auto w = rows_of<D>(weights);
    std::array<Lanes, D * D> sums;
    const auto add = [&](Index j, Index l) {
        const double dx = x[0] - cx[j], dy = x[1] - cy[j], dz = D == 3 ? x[2] - cz[j] : 0.0;
        const double slope = Basis::slope(std::sqrt(dx * dx + dy * dy + dz * dz) * inverse_radius);
        for (std::size_t c = 0; c < D; ++c) {
            const double factor = slope * w[c][j];
            sums[c * D].part[l] += factor * dx;
            sums[c * D + 1].part[l] += factor * dy;
            if constexpr (D == 3) sums[c * D + 2].part[l] += factor * dz;
        }
    };
    for (const auto& [first, last] : runs) {
        Index j = first;
        for (; j + lanes <= last; j += lanes)
            for (Index l = 0; l < lanes; ++l) add(j + l, l);
        for (Index l = 0; j < last; ++j, ++l) add(j, l);
    }
    std::transform(sums.begin(), sums.end(), out.begin(), [](const Lanes& sum) { return sum.total(); });
}

/// out[c, m] = R² Σ_j weights[c, j] ∂φ/∂x_m at a point: R² ∇φ of a tile, then a product with each row of weights.
template <class Basis>
void gradients_over(const Point& x, const FewRuns<max_runs>& runs, Matrix<const double> centres,
                    Matrix<const double> weights, double inverse_radius, Matrix<double> out) {
    if constexpr (fused<Basis>) {
        if (out.shape(0) == 3 && out.shape(1) == 3)
            return few_gradients<Basis, 3>(x, runs, centres, weights, inverse_radius, out);
        if (out.shape(0) == 2 && out.shape(1) == 2)
            return few_gradients<Basis, 2>(x, runs, centres, weights, inverse_radius, out);
    }
    std::fill(out.begin(), out.end(), 0.0);
    const auto [cx, cy, cz] = rows_of<3>(centres);
    std::array<std::array<double, tile_size>, 3> gradients;
    auto& [gx, gy, gz] = gradients;
    for (const auto& [begin, end] : runs)
        for (Index first = begin; first < end; first += tile_size) {
            const Index last = std::min(first + tile_size, end);
            for (Index j = first; j < last; ++j) {
                const double dx = x[0] - cx[j], dy = x[1] - cy[j], dz = x[2] - cz[j];
                const double slope = Basis::slope(std::sqrt(dx * dx + dy * dy + dz * dz) * inverse_radius);
                const auto at = static_cast<std::size_t>(j - first);
                gx[at] = slope * dx, gy[at] = slope * dy, gz[at] = slope * dz;
            }
            for (Index c = 0; c < out.shape(0); ++c) {
                const double* w = weights[c].data() + first;
                for (Index m = 0; m < out.shape(1); ++m) {
                    const double* g = gradients[static_cast<std::size_t>(m)].data();
                    out(c, m) += sum_in_lanes(0, last - first, [&](Index j) { return g[j] * w[j]; });
                }
            }
        }
}

}  // namespace

void sum_values(int code, Matrix<const double> points, Matrix<const double> centres, Matrix<const double> weights,
                double inverse_radius, Vector<const double> origin, double inverse_side, Vector<const Index> shape,
                Vector<const Index> starts, Matrix<double> out) {
    check_sums(points, centres, weights, out.shape(0), out.shape(1));
    const CentreGrid grid(origin, inverse_side, shape, starts, centres.shape(1));
    with_basis(code, [&](auto basis) {
        for_ranges(points.shape(0), points_of_block(grid.visited(), out.shape(1)), [&](Index first, Index last) {
            for (Index i = first; i < last; ++i) {
                const Point x = point_of(points, i);
                sum_over<decltype(basis)>(x, grid.centre_runs(x), centres, weights, inverse_radius, out[i]);
            }
        });
    });
}

void sum_gradients(int code, Matrix<const double> points, Matrix<const double> centres, Matrix<const double> weights,
                   double inverse_radius, Vector<const double> origin, double inverse_side, Vector<const Index> shape,
                   Vector<const Index> starts, Cube<double> out) {
    const Index k = out.shape(1), d = out.shape(2);
    check_sums(points, centres, weights, out.shape(0), k);
    require(1 <= d && d <= 3, "out: expected gradients of one, two or three axes");
    const CentreGrid grid(origin, inverse_side, shape, starts, centres.shape(1));
    const double scale = inverse_radius * inverse_radius;
    with_basis(code, [&](auto basis) {
        for_ranges(points.shape(0), points_of_block(grid.visited(), k * d), [&](Index first, Index last) {
            for (Index i = first; i < last; ++i) {
                const Point x = point_of(points, i);
                gradients_over<decltype(basis)>(x, grid.centre_runs(x), centres, weights, inverse_radius, out[i]);
                for (double& value : out[i]) value *= scale;
            }
        });
    });
}

}  // namespace mesh_motion
