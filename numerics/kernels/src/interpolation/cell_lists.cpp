#include "interpolation/cell_lists.h"

#include <cmath>
#include <limits>
#include <numeric>
#include <tuple>

#include "mesh/sorted_points.h"
#include "parallel.h"

namespace mesh_motion {
namespace {

constexpr Index block = 1 << 14;  // number of points in one task

/// Number of cells of a grid with `more` cells added along each axis.
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

/// Calls f(cell, x, y, z) for every cell that has a point.
template <class F>
void for_filled(Vector<const Index> starts, Vector<const Index> shape, F&& f) {
    require(starts.size() == cells_of(shape) + 1, "starts: expected one more than cells");
    const Index* at = starts.begin();
    for (Index z = 0; z < shape[2]; ++z)
        for (Index y = 0; y < shape[1]; ++y) {
            const Index *const row = at, *const end = row + shape[0];
            for (; *at < *end; ++at) {  // most cells are empty: search for the next one with a point
                if (at[1] == at[0]) at = std::upper_bound(at + 1, end, *at) - 1;
                f(at - starts.begin(), at - row, y, z);
            }
            at = end;
        }
}

/// Share of the pairs that cells must save to be worth their shorter runs: visiting 0.63 of the pairs takes 0.83 of the
/// direct sum's time, 0.3 takes 0.4, 0.03 takes 0.06 (50 000 points, 5 900 centres in 3D).
constexpr double worthwhile_fraction = 0.8;
/// Bounds on the size of the grid: for surfaces most cells of their box are empty, and every cell takes 8 bytes.
constexpr double cells_per_centre = 64.0, most_cells = 1 << 27;
/// Cells are wider than the reach by this factor, so that the rounding of a cell number cannot lose a neighbour.
constexpr double slack = 1.0 + 1e-6;

/// Fills order (n) and starts (cells + 1) of points (n, 3) sorted by cells.
void sort_by_cells(Matrix<const double> points, CentreLayout& layout) {
    const Vector<const double> origin = layout.origin.view();
    const Vector<const Index> shape = layout.shape.view();
    const Index n = points.shape(0), cells = cells_of(shape);
    std::vector<Index> number(n), starts(cells + 2);
    for (Index i = 0; i < n; ++i) {
        for (Index axis = 3; axis-- > 0;) {
            const auto last = static_cast<double>(shape[axis] - 1);
            const double along = std::floor((points(i, axis) - origin[axis]) * layout.inverse_side);
            number[i] = number[i] * shape[axis] + static_cast<Index>(along > 0.0 ? std::min(along, last) : 0.0);
        }
        ++starts[number[i] + 2];
    }
    std::partial_sum(starts.begin(), starts.end(), starts.begin());
    layout.order = owned(std::vector<Index>(n));
    for (Index i = 0; i < n; ++i) layout.order.values[starts[number[i] + 1]++] = i;  // the ends become the starts
    starts.pop_back();
    layout.starts = owned(std::move(starts));
}

/// Number of pairs of points in the same cell or in neighbouring cells.
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

CentreLayout single_cell(Index n, const std::array<double, 3>& low, double extent) {
    std::vector<Index> order(n);
    std::iota(order.begin(), order.end(), Index{0});
    return {owned(std::move(order)), {}, owned(std::vector(low.begin(), low.end())), 0.0, extent,
            owned(std::vector<Index>{1, 1, 1}), owned(std::vector<Index>{0, n}), 1.0};
}

/// Sorts by cells of at least the given side; by wider cells if there would be too many.
CentreLayout sorted_by_cells(Matrix<const double> points, double side, const std::array<double, 3>& low,
                             const std::array<double, 3>& high, double extent) {
    const auto n = static_cast<double>(points.shape(0));
    std::array<double, 3> cells;
    const auto count = [&] {
        for (std::size_t axis = 0; axis < 3; ++axis) cells[axis] = std::floor((high[axis] - low[axis]) / side) + 1.0;
        return cells[0] * cells[1] * cells[2];
    };
    while (count() > std::min(cells_per_centre * n, most_cells)) side *= 2.0;
    CentreLayout layout{{}, {}, owned(std::vector(low.begin(), low.end())), 1.0 / side, extent,
                        owned(std::vector<Index>(cells.begin(), cells.end())), {}, 1.0};
    sort_by_cells(points, layout);
    const Index pairs = count_neighbours(layout.starts.view(), layout.shape.view());
    layout.fraction = static_cast<double>(pairs) / (n * n);
    return layout;
}

}  // namespace

CentreLayout lay_out_centres(Matrix<const double> points, double reach) {
    require(points.shape(1) == 3, "points: expected (n, 3)");
    require(reach >= 0.0 && std::isfinite(reach), "reach: expected a finite number that is not negative");
    const Index n = points.shape(0);
    std::array<double, 3> low{}, high{};
    if (n > 0) std::tie(low, high) = bounding_box(points);
    const double extent = std::max({high[0] - low[0], high[1] - low[1], high[2] - low[2]});
    CentreLayout layout = single_cell(n, low, extent);
    if (reach > 0.0 && n > 0)
        if (CentreLayout by_cells = sorted_by_cells(points, reach * slack, low, high, extent);
            by_cells.fraction < worthwhile_fraction)
            layout = std::move(by_cells);
    layout.coordinates = sorted_rows(points, layout.order.view());
    return layout;
}

CentreLayout lay_out_on_grid(Matrix<const double> points, Vector<const double> origin, double inverse_side,
                             double extent, Vector<const Index> shape) {
    require(points.shape(1) == 3, "points: expected (n, 3)");
    require(origin.size() == 3, "origin: expected three coordinates");
    require(inverse_side >= 0.0 && std::isfinite(inverse_side) && extent >= 0.0 && std::isfinite(extent),
            "inverse_side, extent: expected finite numbers that are not negative");
    require(static_cast<double>(cells_of(shape)) <= most_cells, "shape: expected no more than 2²⁷ cells");
    CentreLayout layout{{}, {}, owned(copied(origin)), inverse_side, extent, owned(copied(shape)), {}, 1.0};
    sort_by_cells(points, layout);
    layout.coordinates = sorted_rows(points, layout.order.view());
    return layout;
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
                    // compared as a double: the cell number of a distant place would not fit into an integer
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
