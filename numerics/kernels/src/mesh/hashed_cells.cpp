#include "mesh/hashed_cells.h"

#include <algorithm>
#include <bit>
#include <limits>

#include "mesh/sorted_points.h"

namespace mesh_motion {
namespace {

constexpr Index around = 27;  // cells around a place; neighbours along x may form one run

/// Fills the table for the cells `held` (c,), ascending, whose points begin at starts (c + 1,).
void fill_table(const std::vector<Index>& held, const std::vector<Index>& starts, StoredCells& out) {
    const auto cells = static_cast<Index>(held.size());
    require(around * cells < std::numeric_limits<std::int32_t>::max(), "points: expected at most 79 million cells");
    const auto size = static_cast<Index>(std::bit_ceil(static_cast<std::uint64_t>(around * cells + 1)));
    Owned<Index, 1> table = owned(std::vector<Index>(size, -1));
    Owned<std::int32_t, 2> table_spans{std::vector<std::int32_t>(2 * size), {size, 2}};
    Owned<std::int32_t, 2> table_runs{std::vector<std::int32_t>(2 * around * cells), {around * cells, 2}};
    const Vector<Index> keys(table.values.data(), {size});
    const Matrix<std::int32_t> spans(table_spans.values.data(), table_spans.shape);
    const Matrix<std::int32_t> runs(table_runs.values.data(), table_runs.shape);

    std::vector<std::array<Index, around>> slots(cells);
    for (Index cell = 0; cell < cells; ++cell)
        for (Index near = 0; near < around; ++near) {
            const Index step = HashedCells::packed(near % 3 - 1, near / 3 % 3 - 1, near / 9 - 1) -
                               HashedCells::packed(0, 0, 0);
            const Index slot = HashedCells::slot(held[cell] + step, keys);
            keys[slot] = held[cell] + step;
            slots[cell][near] = slot;
            ++spans(slot, 1);
        }
    std::int32_t used = 0;
    for (Index slot = 0; slot < size; ++slot) {
        const std::int32_t count = spans(slot, 1);
        spans(slot, 0) = spans(slot, 1) = used;
        used += count;
    }
    for (Index cell = 0; cell < cells; ++cell) {  // ascending, so a cell's runs ascend and can be joined along x
        const auto begin = static_cast<std::int32_t>(starts[cell]), end = static_cast<std::int32_t>(starts[cell + 1]);
        for (const Index slot : slots[cell]) {
            std::int32_t& last = spans(slot, 1);
            if (last > spans(slot, 0) && runs(last - 1, 1) == begin) {
                runs(last - 1, 1) = end;
            } else {
                runs(last, 0) = begin;
                runs(last++, 1) = end;
            }
        }
    }
    out.keys = std::move(table), out.spans = std::move(table_spans), out.runs = std::move(table_runs);
}

}  // namespace

void HashedCells::check() const {
    require(origin.size() == 3, "origin: expected a shape (3,)");
    require(std::has_single_bit(static_cast<std::uint64_t>(keys.size())), "keys: expected a power of two of them");
    require(spans.shape(0) == keys.size() && spans.shape(1) == 2, "spans: expected a shape (t, 2), a row for each key");
    require(runs.shape(1) == 2, "runs: expected a shape (r, 2)");
}

StoredCells store_cells(Matrix<const double> points, Vector<const double> origin, double extent, double side) {
    const Index n = points.shape(0);
    require(n > 0 && points.shape(1) == 3, "points: expected (n, 3) of at least one");
    require(n < std::numeric_limits<std::int32_t>::max(), "points: expected fewer than 2^31");
    require(side > 0.0 && std::isfinite(side), "side: expected a finite number > 0");
    require(origin.size() == 3, "origin: expected three coordinates");
    const auto [low, high] = bounding_box(points);
    for (std::size_t axis = 0; axis < 3; ++axis)
        require(origin[axis] <= low[axis] && high[axis] - origin[axis] <= extent,
                "origin, extent: expected a cube that holds the points");
    side = std::max(side, extent / ((1 << HashedCells::bits) - 4));
    std::vector<std::pair<Index, Index>> sorted(n);  // by cell, then by number
    for (Index i = 0; i < n; ++i) {
        const auto place = [&](Index axis) {
            return static_cast<Index>(std::floor((points(i, axis) - origin[axis]) / side));
        };
        sorted[i] = {HashedCells::packed(place(0), place(1), place(2)), i};
    }
    std::sort(sorted.begin(), sorted.end());
    std::vector<Index> order(n), held, starts;
    for (Index j = 0; j < n; ++j) {
        order[j] = sorted[j].second;
        if (j == 0 || sorted[j].first != held.back()) {
            held.push_back(sorted[j].first);
            starts.push_back(j);
        }
    }
    starts.push_back(n);
    StoredCells out{owned(std::move(order)), {}, owned(copied(origin)), 1.0 / side, {}, {}, {}};
    out.coordinates = sorted_rows(points, out.order.view());
    fill_table(held, starts, out);
    return out;
}

}  // namespace mesh_motion
