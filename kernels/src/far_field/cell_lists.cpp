#include "far_field/cell_lists.h"

#include <cmath>
#include <limits>
#include <numeric>

#include "parallel.h"

namespace mesh_motion {
namespace {

constexpr Index block = 1 << 14;  // points of one task

/// How many cells a grid has with `more` of them added along each axis.
Index cells_of(Vector<const Index> shape, Index more = 0) {
    require(shape.size() == 3, "shape: expected three numbers of cells");
    constexpr Index most = std::numeric_limits<Index>::max() / 2;
    Index cells = 1;
    for (Index n : shape) {
        require(0 < n && n <= most / cells - more, "shape: expected cells along each axis");
        cells *= n + more;
    }
    return cells;
}

/// f(cell, x, y, z) for every cell that holds a point.
template <class F>
void for_filled(Vector<const Index> starts, Vector<const Index> shape, F&& f) {
    require(starts.size() == cells_of(shape) + 1, "starts: expected one more than cells");
    Index cell = 0;
    for (Index z = 0; z < shape[2]; ++z)
        for (Index y = 0; y < shape[1]; ++y)
            for (Index x = 0; x < shape[0]; ++x, ++cell)
                if (starts[cell + 1] > starts[cell]) f(cell, x, y, z);
}

}  // namespace

void sort_by_cells(Matrix<const double> points, Vector<const double> origin, double inverse_side,
                   Vector<const Index> shape, Vector<Index> order, Vector<Index> starts) {
    const Index n = points.shape(0), cells = cells_of(shape);
    require(points.shape(1) == 3 && origin.size() == 3, "points, origin: expected (n, 3), (3,)");
    require(order.size() == n && starts.size() == cells + 1, "order, starts: expected (n,), (cells + 1,)");
    std::vector<Index> number(n), place(cells + 1);
    for (Index i = 0; i < n; ++i) {
        for (Index axis = 3; axis-- > 0;) {
            const auto last = static_cast<double>(shape[axis] - 1);
            const double along = std::floor((points(i, axis) - origin[axis]) * inverse_side);
            number[i] = number[i] * shape[axis] + static_cast<Index>(along > 0.0 ? std::min(along, last) : 0.0);
        }
        ++place[number[i] + 1];
    }
    std::partial_sum(place.begin(), place.end(), place.begin());
    std::copy(place.begin(), place.end(), starts.begin());
    for (Index i = 0; i < n; ++i) order[place[number[i]]++] = i;
}

Index count_neighbours(Vector<const Index> starts, Vector<const Index> shape) {
    Index pairs = 0;
    for_filled(starts, shape, [&](Index cell, Index x, Index y, Index z) {
        const Index low = std::max<Index>(x - 1, 0), high = std::min(x + 1, shape[0] - 1);
        for (Index iz = std::max<Index>(z - 1, 0); iz <= std::min(z + 1, shape[2] - 1); ++iz)
            for (Index iy = std::max<Index>(y - 1, 0); iy <= std::min(y + 1, shape[1] - 1); ++iy) {
                const Index row = (iz * shape[1] + iy) * shape[0];
                pairs += (starts[cell + 1] - starts[cell]) * (starts[row + high + 1] - starts[row + low]);
            }
    });
    return pairs;
}

void mark_neighbours(Vector<const Index> starts, Vector<const Index> shape, Vector<bool> reached) {
    require(reached.size() == cells_of(shape, 2), "reached: expected the cells with one more on each side");
    for_filled(starts, shape, [&](Index, Index x, Index y, Index z) {
        for (Index iz = z; iz < z + 3; ++iz)
            for (Index iy = y; iy < y + 3; ++iy) {
                const Index row = (iz * (shape[1] + 2) + iy) * (shape[0] + 2) + x;
                reached[row] = reached[row + 1] = reached[row + 2] = true;
            }
    });
}

void mark_reached(Matrix<const double> points, Vector<const double> origin, double inverse_side,
                  Vector<const Index> shape, Vector<const bool> reached, Vector<bool> out) {
    require(reached.size() == cells_of(shape, 2), "reached: expected the cells with one more on each side");
    require(origin.size() == 3 && out.size() == points.shape(0), "origin, out: expected (3,), (n,)");
    with_dimension(points.shape(1), [&](auto dimension) {
        constexpr int d = dimension;
        for_ranges(out.size(), block, [&](Index first, Index last) {
            for (Index i = first; i < last; ++i) {
                bool inside = true;
                Index cell = 0;
                for (int axis = 3; axis-- > 0;) {
                    const double x = axis < d ? points(i, axis) : 0.0, place = (x - origin[axis]) * inverse_side + 1.0;
                    const auto cells = static_cast<double>(shape[axis] + 2);
                    // compared before it becomes an integer: a place far away would not fit into one
                    const bool along = (0.0 <= place) & (place < cells);
                    inside &= along;
                    cell = cell * (shape[axis] + 2) + static_cast<Index>(along ? place : 0.0);
                }
                out[i] = inside && reached[cell];
            }
        });
    });
}

}  // namespace mesh_motion
