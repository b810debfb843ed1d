#include "interpolation/assembly.h"

#include <optional>

#include "interpolation/summation.h"
#include "mesh/hashed_cells.h"
#include "parallel.h"

namespace mesh_motion {
namespace {

constexpr Index rows_of_block = 256;

/// Finds the runs of centres near a place, by one of two grids.
class Search {
  public:
    Search(Matrix<const double> points, Matrix<const double> centres, Vector<const double> origin, double inverse_side,
           Vector<const Index> shape, Vector<const Index> starts, Vector<const Index> keys,
           Matrix<const std::int32_t> spans, Matrix<const std::int32_t> stored)
        : stored_{origin, inverse_side, keys, spans, stored} {
        require(points.shape(1) == 3 && centres.shape(0) == 3, "points, centres: expected shapes (n, 3) and (3, nc)");
        if (keys.size()) {
            stored_.check();
        } else {
            all_.emplace(origin, inverse_side, shape, starts, centres.shape(1));
        }
    }

    FewRuns<27> near(const Point& x) const {
        FewRuns<27> runs;
        if (all_) {
            for (const auto& [first, last] : all_->centre_runs(x)) runs.add(first, last);
        } else {
            const auto found = stored_.near(x[0], x[1], x[2]);
            for (Index run = 0; run < found.shape(0); ++run) runs.add(found(run, 0), found(run, 1));
        }
        return runs;
    }

  private:
    std::optional<CentreGrid> all_;
    HashedCells stored_;
};

}  // namespace

void fill_block(int code, Matrix<const double> rows, Matrix<const double> columns, double inverse_radius,
                Matrix<double> out) {
    require(rows.shape(1) == 3 && columns.shape(0) == 3, "rows, columns: expected shapes (m, 3) and (3, n)");
    require(out.shape(0) == rows.shape(0) && out.shape(1) == columns.shape(1), "out: expected shape (m, n)");
    const auto [cx, cy, cz] = rows_of<3>(columns);
    const Index n = columns.shape(1);
    with_basis(code, [&](auto basis) {
        for_ranges(rows.shape(0), 1 + (1 << 16) / (n + 1), [&](Index first, Index last) {
            for (Index i = first; i < last; ++i) {
                const Point x = point_of(rows, i);
                double* __restrict row = out[i].data();
                for (Index j = 0; j < n; ++j) {
                    const double dx = x[0] - cx[j], dy = x[1] - cy[j], dz = x[2] - cz[j];
                    row[j] = basis.phi(std::sqrt(dx * dx + dy * dy + dz * dz) * inverse_radius);
                }
            }
        });
    });
}

Owned<Index, 1> count_near(Matrix<const double> points, Matrix<const double> centres, double radius,
                           Vector<const double> origin, double inverse_side, Vector<const Index> shape,
                           Vector<const Index> starts, Vector<const Index> keys, Matrix<const std::int32_t> spans,
                           Matrix<const std::int32_t> stored) {
    const Search search(points, centres, origin, inverse_side, shape, starts, keys, spans, stored);
    const auto [cx, cy, cz] = rows_of<3>(centres);
    std::vector<Index> counts(static_cast<std::size_t>(points.shape(0)));
    for_ranges(points.shape(0), rows_of_block, [&](Index begin, Index end) {
        for (Index i = begin; i < end; ++i) {
            const Point x = point_of(points, i);
            Index count = 0;
            for (const auto& [first, last] : search.near(x))
                for (Index j = first; j < last; ++j) {
                    const double dx = x[0] - cx[j], dy = x[1] - cy[j], dz = x[2] - cz[j];
                    count += dx * dx + dy * dy + dz * dz < radius * radius;
                }
            counts[static_cast<std::size_t>(i)] = count;
        }
    });
    return owned(std::move(counts));
}

void fill_rows(int code, Matrix<const double> points, Matrix<const double> centres, Vector<const Index> numbers,
               double radius, Vector<const double> origin, double inverse_side, Vector<const Index> shape,
               Vector<const Index> starts, Vector<const Index> keys, Matrix<const std::int32_t> spans,
               Matrix<const std::int32_t> stored, Vector<const std::int32_t> pointers, Vector<std::int32_t> columns,
               Vector<double> entries) {
    const Search search(points, centres, origin, inverse_side, shape, starts, keys, spans, stored);
    require(numbers.size() == centres.shape(1), "numbers: expected one for each centre");
    require(pointers.size() == points.shape(0) + 1, "pointers: expected one more than points");
    require(columns.size() == entries.size(), "columns, entries: expected the same length");
    const auto [cx, cy, cz] = rows_of<3>(centres);
    const double inverse_radius = 1.0 / radius;
    with_basis(code, [&](auto basis) {
        for_ranges(points.shape(0), rows_of_block, [&](Index begin, Index end) {
            std::vector<Index> near;
            std::vector<double> squares;
            for (Index i = begin; i < end; ++i) {
                const Point x = point_of(points, i);
                const FewRuns<27> runs = search.near(x);
                std::size_t visited = 1, found = 0;
                for (const auto& [first, last] : runs) visited += static_cast<std::size_t>(last - first);
                if (visited > near.size()) near.resize(2 * visited), squares.resize(2 * visited);
                for (const auto& [first, last] : runs)
                    for (Index j = first; j < last; ++j) {  // kept, or written over by the next: no branch
                        const double dx = x[0] - cx[j], dy = x[1] - cy[j], dz = x[2] - cz[j];
                        near[found] = j;
                        squares[found] = dx * dx + dy * dy + dz * dz;
                        found += squares[found] < radius * radius;
                    }
                const auto count = static_cast<Index>(found);
                require(0 <= pointers[i] && pointers[i] + count == pointers[i + 1] && pointers[i + 1] <= columns.size(),
                        "pointers: expected the sums of the counts of centres near points");
                std::int32_t* __restrict column = columns.data() + pointers[i];
                double* __restrict entry = entries.data() + pointers[i];
                for (std::size_t e = 0; e < found; ++e) column[e] = static_cast<std::int32_t>(numbers[near[e]]);
                for (std::size_t e = 0; e < found; ++e) entry[e] = basis.phi(std::sqrt(squares[e]) * inverse_radius);
            }
        });
    });
}

}  // namespace mesh_motion
