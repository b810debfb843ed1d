#include "interpolation/reduction.h"

#include <limits>
#include <numeric>

#include "interpolation/summation.h"

namespace mesh_motion {

Owned<double, 1> lengths(Matrix<const double> vectors) {
    std::vector<double> found(static_cast<std::size_t>(vectors.shape(0)));
    for (Index i = 0; i < vectors.shape(0); ++i) {
        double total = 0.0;
        for (Index c = 0; c < vectors.shape(1); ++c) total += vectors(i, c) * vectors(i, c);
        found[static_cast<std::size_t>(i)] = std::sqrt(total);
    }
    return owned(std::move(found));
}

void add_multiple(Matrix<double> error, Vector<const double> column, Vector<const double> factor) {
    require(column.size() == error.shape(0) && factor.size() == error.shape(1), "column, factor: expected (n,), (k,)");
    for (Index i = 0; i < error.shape(0); ++i)
        for (Index c = 0; c < error.shape(1); ++c) error(i, c) += column[i] * factor[c];
}

Index subtract_function(int code, Matrix<const double> points, Index node, double inverse_radius,
                        Vector<const double> beta, Matrix<double> error, Vector<double> size) {
    const Index n = points.shape(0), k = beta.size();
    require(points.shape(1) == 3 && 0 <= node && node < n, "points, node: expected shape (n, 3) and one of them");
    require(error.shape(0) == n && error.shape(1) == k && size.size() == n, "error, size: expected (n, k) and (n,)");
    const Point x = point_of(points, node);
    Index largest = 0;
    with_basis(code, [&](auto basis) {
        std::array<double, tile_size> values;
        for (Index first = 0; first < n; first += tile_size) {
            const Index last = std::min(first + tile_size, n);
            for (Index i = first; i < last; ++i) {
                const double dx = points(i, 0) - x[0], dy = points(i, 1) - x[1], dz = points(i, 2) - x[2];
                values[static_cast<std::size_t>(i - first)] =
                    basis.phi(std::sqrt(dx * dx + dy * dy + dz * dz) * inverse_radius);
            }
            for (Index i = first; i < last; ++i) {
                double total = 0.0;
                for (Index c = 0; c < k; ++c) {
                    error(i, c) -= values[static_cast<std::size_t>(i - first)] * beta[c];
                    total += error(i, c) * error(i, c);
                }
                size[i] = std::sqrt(total);
                if (size[i] > size[largest]) largest = i;
            }
        }
    });
    return largest;
}

std::pair<Owned<Index, 1>, Owned<double, 1>> farthest_first(Matrix<const double> points, Vector<const Index> given) {
    const Index n = points.shape(0);
    require(points.shape(1) == 3 && given.size() <= n, "points, given: expected shape (n, 3) and no more of them");
    for (Index point : given) require(0 <= point && point < n, "given: expected numbers of points");
    std::vector<Index> order(static_cast<std::size_t>(n)), number(order.size()), place(order.size());
    std::vector<double> separation(order.size()), nearest(order.size(), std::numeric_limits<double>::infinity());
    // the points not yet taken, packed, with their numbers and squared distances from those that are
    std::array<std::vector<double>, 3> left;
    for (std::size_t axis = 0; axis < 3; ++axis)
        for (Index i = 0; i < n; ++i) left[axis].push_back(points(i, static_cast<Index>(axis)));
    std::iota(number.begin(), number.end(), Index{0});
    place = number;  // of a point among those left
    for (std::size_t rank = 0; rank < order.size(); ++rank) {
        const std::size_t count = order.size() - rank, last = count - 1;
        if (rank < static_cast<std::size_t>(given.size())) {
            order[rank] = given[static_cast<Index>(rank)];
            require(place[static_cast<std::size_t>(order[rank])] >= 0, "given: expected different points");
        } else {
            // in two passes, which become vector code
            Lanes most;
            for (double& part : most.part) part = -1.0;
            std::size_t i = 0;
            for (; i + lanes <= count; i += lanes)
                for (std::size_t l = 0; l < lanes; ++l) most.part[l] = std::max(most.part[l], nearest[i + l]);
            for (; i < count; ++i) most.part[0] = std::max(most.part[0], nearest[i]);
            const double farthest = *std::max_element(most.part, most.part + lanes);
            Index lowest = n;
            for (i = 0; i < count; ++i) lowest = nearest[i] == farthest ? std::min(lowest, number[i]) : lowest;
            order[rank] = lowest;
        }
        const auto at = static_cast<std::size_t>(std::exchange(place[static_cast<std::size_t>(order[rank])], -1));
        separation[rank] = std::sqrt(nearest[at]);
        const Point x = {left[0][at], left[1][at], left[2][at]};
        for (auto& row : left) row[at] = row[last];  // the last one moves into the gap
        nearest[at] = nearest[last];
        if (at < last) place[static_cast<std::size_t>(number[at] = number[last])] = static_cast<Index>(at);
        const double *px = left[0].data(), *py = left[1].data(), *pz = left[2].data();
        double* __restrict distance = nearest.data();
        for (std::size_t i = 0; i < last; ++i) {
            const double dx = px[i] - x[0], dy = py[i] - x[1], dz = pz[i] - x[2];
            distance[i] = std::min(distance[i], dx * dx + dy * dy + dz * dz);
        }
    }
    return {owned(std::move(order)), owned(std::move(separation))};
}

Owned<double, 1> forward_substitute(Matrix<const double> lower, Vector<const double> right) {
    const Index n = right.size();
    require(n <= lower.shape(0) && n <= lower.shape(1), "lower: expected an order of at least n");
    std::vector<double> x(static_cast<std::size_t>(n));
    for (Index i = 0; i < n; ++i) {
        const double *row = lower[i].data(), *known = x.data();
        const double sum = sum_in_lanes(0, i, [&](Index j) { return row[j] * known[j]; });
        x[static_cast<std::size_t>(i)] = (right[i] - sum) / row[i];
    }
    return owned(std::move(x));
}

Owned<double, 2> back_substitute(Matrix<const double> lower, Matrix<const double> right) {
    const Index n = right.shape(0), k = right.shape(1);
    require(n <= lower.shape(0) && n <= lower.shape(1), "lower: expected an order of at least n");
    Owned<double, 2> found{std::vector<double>(right.begin(), right.end()), {n, k}};
    std::vector<double> columns(found.values.size());  // (k, n)
    const Matrix<double> x(columns.data(), {k, n}), out(found.values.data(), {n, k});
    for (Index i = 0; i < n; ++i)
        for (Index c = 0; c < k; ++c) x(c, i) = right(i, c);
    for (Index i = n - 1; i >= 0; --i) {
        const double* row = lower[i].data();
        for (Index c = 0; c < k; ++c) {
            double* __restrict column = x[c].data();
            const double solved = column[i] /= row[i];
            for (Index j = 0; j < i; ++j) column[j] -= row[j] * solved;
        }
    }
    for (Index i = 0; i < n; ++i)
        for (Index c = 0; c < k; ++c) out(i, c) = x(c, i);
    return found;
}

}  // namespace mesh_motion
