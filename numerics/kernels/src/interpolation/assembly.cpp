#include "interpolation/assembly.h"

#include <bit>
#include <limits>
#include <memory>
#include <numeric>
#include <optional>
#include <utility>

#ifdef __AVX512F__
#include <immintrin.h>
#endif

#include "interpolation/cell_lists.h"
#include "interpolation/summation.h"
#include "lanes.h"
#include "mesh/hashed_cells.h"
#include "parallel.h"

namespace mesh_motion {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr Index rows_of_block = 1024, points_of_block = 1 << 12;

/// Finds the runs of centres near a place, with one of two kinds of grids.
class Search {
  public:
    Search(Matrix<const double> centres, Vector<const double> origin, double inverse_side, Vector<const Index> shape,
           Vector<const Index> starts, Vector<const Index> keys, Matrix<const std::int32_t> spans,
           Matrix<const std::int32_t> stored)
        : centres(centres), stored_{origin, inverse_side, keys, spans, stored} {
        require(centres.shape(0) == 3, "centres: expected shape (3, nc)");
        if (keys.size()) {
            stored_.check();
        } else {
            all_.emplace(origin, inverse_side, shape, starts, centres.shape(1));
        }
    }

    /// Cells have the numbers 0 … cells() − 1.
    Index cells() const { return all_ ? all_->cells_around() : stored_.keys.size(); }

    /// The cell of a place; all places in one cell have the same centres near. −1 if no centre is near.
    Index cell(const Point& x) const { return all_ ? all_->number(x) : stored_.place(stored_.key_of(x[0], x[1], x[2])); }

    /// The cells of the points first … first + count − 1 (n, d).
    template <int d>
    void cells_of(Matrix<const double> points, Index first, Index count, std::int32_t* found) const {
        if (all_) return all_->numbers<d>(points, first, count, found);
        for (Index i = 0; i < count; ++i) {
            Point x{};
            for (int axis = 0; axis < d; ++axis) x[axis] = points(first + i, axis);
            found[i] = static_cast<std::int32_t>(cell(x));
        }
    }

    /// (cells()) marks the cells that have centres near; null: all of them.
    std::unique_ptr<bool[]> reached() const {
        if (!all_) return nullptr;
        auto marks = std::make_unique<bool[]>(cells());
        mark_neighbours(all_->starts, view_of(all_->shape), Vector<bool>(marks.get(), {cells()}));
        return marks;
    }

    /// Calls f(first, last) for the runs of centres near the cell of a place.
    template <class F>
    void for_runs(const Point& x, Index cell, F&& f) const {
        if (all_) {
            for (const auto& [first, last] : all_->centre_runs(x)) f(first, last);
        } else {
            const auto found = stored_.near(cell);
            for (Index run = 0; run < found.shape(0); ++run) {
                const Index first = found(run, 0), last = found(run, 1);
                require(0 <= first && first <= last && last <= centres.shape(1), "stored: expected numbers of centres");
                f(first, last);
            }
        }
    }

    const Matrix<const double> centres;

  private:
    std::optional<CentreGrid> all_;
    HashedCells stored_;
};

/// The centres near a cell, side by side: points that are adjacent in memory mostly share one cell.
class NearCell {
  public:
    /// numbers: the numbers by which centres are returned; empty if they are not needed.
    explicit NearCell(const Search& search, Vector<const Index> numbers = {}) : search_(search), called_(numbers) {}

    /// Selects the cell of a place; returns the number of centres near it.
    Index take(const Point& x) {
        const Index cell = search_.cell(x);
        if (taken_ && cell == cell_) return count_;
        cell_ = cell, taken_ = true, count_ = 0;
        search_.for_runs(x, cell, [&](Index first, Index last) {
            const Index count = count_ + last - first + lanes;
            if (static_cast<Index>(numbers_.size()) < count) {
                for (auto* along : {&x_, &y_, &z_, &squares_}) along->resize(2 * count);
                numbers_.resize(2 * count);
            }
            const auto *xs = search_.centres[0].data(), *ys = search_.centres[1].data(), *zs = search_.centres[2].data();
            for (Index j = first; j < last; ++j, ++count_) {
                x_[count_] = xs[j], y_[count_] = ys[j], z_[count_] = zs[j];
                if (called_.size()) numbers_[count_] = static_cast<std::int32_t>(called_[j]);
            }
        });
        // fill whole registers with centres that are near no place
        for (Index at = count_; at % lanes; ++at) x_[at] = infinity, y_[at] = z_[at] = 0.0;
        return count_;
    }

    /// The number of these centres closer to a place than R.
    Index closer(const Point& at, double square_radius) {
        const double *xs = x_.data(), *ys = y_.data(), *zs = z_.data();
        double* __restrict squares = squares_.data();
        Index count = 0;
        for (Index first = 0; first < count_; first += lanes)
            for (Index j = first; j < first + lanes; ++j) {
                const double dx = at[0] - xs[j], dy = at[1] - ys[j], dz = at[2] - zs[j];
                squares[j] = dx * dx + dy * dy + dz * dz;
                count += squares[j] < square_radius;
            }
        return count;
    }

    /// The numbers and squared distances of the centres that `closer` counted; the arrays need room for one register
    /// more.
    void list(double square_radius, std::int32_t* __restrict numbers, double* __restrict squares) const {
        Index found = 0;
#ifdef __AVX512F__
        const __m512d radius = _mm512_set1_pd(square_radius);
        for (Index j = 0; j < count_; j += lanes) {
            const __m512d here = _mm512_loadu_pd(&squares_[j]);
            const __mmask8 close = _mm512_cmp_pd_mask(here, radius, _CMP_LT_OQ);
            const __m256i called = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(&numbers_[j]));
            _mm512_storeu_pd(squares + found, _mm512_maskz_compress_pd(close, here));
            _mm256_storeu_si256(reinterpret_cast<__m256i*>(numbers + found), _mm256_maskz_compress_epi32(close, called));
            found += std::popcount(static_cast<unsigned>(close));
        }
#else
        for (Index j = 0; j < count_; ++j) {  // without a branch: each is kept, or overwritten by the next
            numbers[found] = numbers_[j];
            squares[found] = squares_[j];
            found += squares_[j] < square_radius;
        }
#endif
    }

  private:
    const Search& search_;
    const Vector<const Index> called_;
    Index cell_ = 0, count_ = 0;
    bool taken_ = false;
    std::vector<double> x_, y_, z_, squares_;
    std::vector<std::int32_t> numbers_;
};

}  // namespace

std::pair<Owned<Index, 1>, Owned<double, 2>> rows_near(Matrix<const double> points, Vector<const Index> skipped,
                                                       Matrix<const double> centres, Vector<const double> origin,
                                                       double inverse_side, Vector<const Index> shape,
                                                       Vector<const Index> starts, Vector<const Index> keys,
                                                       Matrix<const std::int32_t> spans,
                                                       Matrix<const std::int32_t> stored) {
    const Search search(centres, origin, inverse_side, shape, starts, keys, spans, stored);
    const Index n = points.shape(0), d = points.shape(1);
    require(n <= std::numeric_limits<std::int32_t>::max() && search.cells() <= std::numeric_limits<std::int32_t>::max(),
            "points, centres: expected no more than numbers of 32 bits");
    const auto reached = search.reached();
    std::vector<char> asked(n, 1);
    for (Index i : skipped) {
        require(0 <= i && i < n, "skipped: expected rows of points");
        asked[i] = 0;
    }
    struct Found {
        std::int32_t row, cell;
    };
    std::vector<std::vector<Found>> found((n + points_of_block - 1) / points_of_block);
    with_dimension(d, [&](auto dimension) {
        for_ranges(n, points_of_block, [&](Index begin, Index end) {
            std::array<Found, points_of_block> here;
            std::array<std::int32_t, points_of_block> cells;
            search.cells_of<dimension>(points, begin, end - begin, cells.data());
            Index count = 0;
            for (Index i = begin; i < end; ++i) {
                const std::int32_t cell = cells[i - begin];
                here[count] = {static_cast<std::int32_t>(i), cell};
                count += (cell >= 0) & asked[i] & (!reached || reached[std::max(cell, 0)]);  // without a branch
            }
            found[begin / points_of_block].assign(here.begin(), here.begin() + count);
        });
    });
    std::vector<std::int32_t> next(search.cells() + 1);  // of each cell, the place of its next row
    for (const auto& here : found)
        for (const auto& [row, cell] : here) ++next[cell + 1];
    std::partial_sum(next.begin(), next.end(), next.begin());
    std::vector<Index> rows(next.back());
    for (const auto& here : found)
        for (const auto& [row, cell] : here) rows[next[cell]++] = row;
    const auto r = static_cast<Index>(rows.size());
    Owned<double, 2> places{std::vector<double>(3 * r), {r, 3}};
    for_ranges(r, points_of_block, [&](Index begin, Index end) {
        for (Index j = begin; j < end; ++j)
            for (Index axis = 0; axis < d; ++axis) places.values[3 * j + axis] = points(rows[j], axis);
    });
    return {owned(std::move(rows)), std::move(places)};
}

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
    require(points.shape(1) == 3, "points: expected shape (n, 3)");
    const Search search(centres, origin, inverse_side, shape, starts, keys, spans, stored);
    std::vector<Index> counts(static_cast<std::size_t>(points.shape(0)));
    for_ranges(points.shape(0), rows_of_block, [&](Index begin, Index end) {
        NearCell cell(search);
        for (Index i = begin; i < end; ++i) {
            const Point x = point_of(points, i);
            counts[static_cast<std::size_t>(i)] = cell.take(x) ? cell.closer(x, radius * radius) : 0;
        }
    });
    return owned(std::move(counts));
}

SparseMatrix near_rows(int code, Matrix<const double> points, Matrix<const double> centres, Vector<const Index> numbers,
                       double radius, Vector<const double> origin, double inverse_side, Vector<const Index> shape,
                       Vector<const Index> starts, Vector<const Index> keys, Matrix<const std::int32_t> spans,
                       Matrix<const std::int32_t> stored) {
    require(points.shape(1) == 3, "points: expected shape (n, 3)");
    const Search search(centres, origin, inverse_side, shape, starts, keys, spans, stored);
    require(numbers.size() == centres.shape(1), "numbers: expected one for each centre");
    const double inverse_radius = 1.0 / radius;
    const Index n = points.shape(0);
    struct Part {
        UnfilledVector<std::int32_t> columns;
        UnfilledVector<double> entries;
    };
    std::vector<Part> parts((n + rows_of_block - 1) / rows_of_block);
    std::vector<Index> ends(n + 1);
    with_basis(code, [&](auto basis) {
        for_ranges(n, rows_of_block, [&](Index begin, Index end) {
            Part part;  // local: adjacent counters would share cache lines
            NearCell cell(search, numbers);
            for (Index i = begin; i < end; ++i) {
                const Point x = point_of(points, i);
                const Index count = cell.take(x) ? cell.closer(x, radius * radius) : 0;
                ends[i + 1] = count;
                if (count == 0) continue;  // no centre is near: most points of cells that only touch a centre's cell
                const std::size_t at = part.entries.size();
                part.columns.resize(at + count + lanes);
                part.entries.resize(at + count + lanes);
                double* __restrict entry = part.entries.data() + at;
                cell.list(radius * radius, part.columns.data() + at, entry);
                part.columns.resize(at + count);
                part.entries.resize(at + count);
                for (Index e = 0; e < count; ++e) entry[e] = basis.phi(std::sqrt(entry[e]) * inverse_radius);
            }
            parts[begin / rows_of_block] = std::move(part);
        });
    });
    std::partial_sum(ends.begin(), ends.end(), ends.begin());
    require(ends[n] <= std::numeric_limits<std::int32_t>::max(), "expected fewer entries than 2³¹");
    UnfilledVector<std::int32_t> columns(ends[n]);
    UnfilledVector<double> entries(ends[n]);
    for_blocks(static_cast<Index>(parts.size()), [&](Index b) {
        const Part part = std::exchange(parts[b], {});
        std::copy(part.columns.begin(), part.columns.end(), columns.begin() + ends[b * rows_of_block]);
        std::copy(part.entries.begin(), part.entries.end(), entries.begin() + ends[b * rows_of_block]);
    });
    return {owned(std::vector<std::int32_t>(ends.begin(), ends.end())), owned(std::move(columns)),
            owned(std::move(entries))};
}

}  // namespace mesh_motion
