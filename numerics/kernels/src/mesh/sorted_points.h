// Points in the order in which the sums use them, and the box around them.
#pragma once

#include <algorithm>
#include <cmath>
#include <utility>

#include "view.h"

namespace mesh_motion {

/// Lower and upper corner of points (n, 3), n > 0, whose extent must be a number.
inline std::pair<std::array<double, 3>, std::array<double, 3>> bounding_box(Matrix<const double> points) {
    std::array<double, 3> low{points(0, 0), points(0, 1), points(0, 2)}, high = low;
    bool finite = true;
    for (Index i = 0; i < points.shape(0); ++i)
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const double x = points(i, axis);
            finite &= std::isfinite(x);
            low[axis] = std::min(low[axis], x);
            high[axis] = std::max(high[axis], x);
        }
    for (std::size_t axis = 0; axis < 3; ++axis) finite &= std::isfinite(high[axis] - low[axis]);
    require(finite, "points: expected finite coordinates");
    return {low, high};
}

/// (3, n) coordinates of points (n, 3) in an order (n,).
inline Owned<double, 2> sorted_rows(Matrix<const double> points, Vector<const Index> order) {
    const Index n = order.size();
    Owned<double, 2> rows{std::vector<double>(3 * n), {3, n}};
    for (Index axis = 0; axis < 3; ++axis)
        for (Index j = 0; j < n; ++j) rows.values[axis * n + j] = points(order[j], axis);
    return rows;
}

}  // namespace mesh_motion
