#include "correction/block_cholesky.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "quad.h"

namespace mesh_motion {
namespace {

constexpr Index smallest_part = 8;  // smaller parts, in nodes, are not cut further

/// Nested dissection: first both halves of a box, then the few nodes between them.
struct Dissection {
    Vector<const Index> row_starts;
    Vector<const std::int32_t> columns;
    Matrix<const double> places;
    std::vector<std::int32_t> order;
    std::vector<char> upper;  // the half of the box that is cut next

    void cut(std::int32_t* first, std::int32_t* last) {
        if (last - first <= smallest_part) {
            std::sort(first, last);
            order.insert(order.end(), first, last);
            return;
        }
        std::int32_t* middle = first + (last - first) / 2;
        Index best = 0;
        std::ptrdiff_t fewest = last - first;
        for (Index axis = 0; axis < places.shape(1); ++axis) {
            halve(first, middle, last, axis);
            const auto count = std::count_if(first, middle, [&](std::int32_t node) { return borders(node); });
            if (count < fewest) fewest = count, best = axis;
            unmark(middle, last);
        }
        halve(first, middle, last, best);
        std::int32_t* between = std::partition(first, middle, [&](std::int32_t node) { return !borders(node); });
        unmark(middle, last);
        cut(first, between);
        cut(middle, last);
        std::sort(between, middle);
        order.insert(order.end(), between, middle);
    }

    /// Moves the upper half along an axis to middle … last − 1, and marks it.
    void halve(std::int32_t* first, std::int32_t* middle, std::int32_t* last, Index axis) {
        std::nth_element(first, middle, last, [&](std::int32_t a, std::int32_t b) {
            return std::pair{places(a, axis), a} < std::pair{places(b, axis), b};
        });
        for (const std::int32_t* node = middle; node < last; ++node) upper[*node] = 1;
    }

    void unmark(const std::int32_t* first, const std::int32_t* last) {
        for (; first < last; ++first) upper[*first] = 0;
    }

    /// Whether a node has a neighbour in the upper half.
    bool borders(std::int32_t node) const {
        for (Index e = row_starts[node]; e < row_starts[node + 1]; ++e)
            if (upper[columns[e]]) return true;
        return false;
    }
};

void require_system(Vector<const Index> row_starts, Vector<const std::int32_t> columns) {
    require_starts(row_starts, columns.size(), "row_starts: expected to ascend up to all columns");
    require_below(columns, row_starts.size() - 1, "columns: expected numbers of nodes");
}

/// a −= b cᵀ.
template <int d>
void subtract_product(double* a, const double* b, const double* c) {
    for (int i = 0; i < d; ++i)
        for (int j = 0; j < d; ++j) {
            double sum = 0.0;
            for (int k = 0; k < d; ++k) sum += b[i * d + k] * c[j * d + k];
            a[i * d + j] -= sum;
        }
}

/// Replaces a symmetric block by its lower triangular factor; false if the block is not positive definite.
template <int d>
bool factorize(double* a) {
    for (int j = 0; j < d; ++j) {
        double pivot = a[j * d + j];
        for (int k = 0; k < j; ++k) pivot -= a[j * d + k] * a[j * d + k];
        if (!(pivot > 0.0)) return false;
        a[j * d + j] = std::sqrt(pivot);
        for (int i = j + 1; i < d; ++i) {
            double sum = a[i * d + j];
            for (int k = 0; k < j; ++k) sum -= a[i * d + k] * a[j * d + k];
            a[i * d + j] = sum / a[j * d + j];
            a[j * d + i] = 0.0;
        }
    }
    return true;
}

/// Replaces a by a L⁻ᵀ.
template <int d>
void divide(double* a, const double* factor) {
    for (int i = 0; i < d; ++i)
        for (int j = 0; j < d; ++j) {
            double sum = a[i * d + j];
            for (int k = 0; k < j; ++k) sum -= a[i * d + k] * factor[j * d + k];
            a[i * d + j] = sum / factor[j * d + j];
        }
}

/// Computes L of H = L Lᵀ column by column, each from the columns before it (left-looking).
template <int d>
struct Factor {
    static constexpr Index size = d * d;
    Vector<const Index> starts;
    Vector<const std::int32_t> rows;
    double *diagonal, *below;

    bool compute(Vector<const Index> row_starts, Vector<const std::int32_t> columns, Cube<const double> blocks,
                 Vector<const std::int32_t> order, const std::vector<std::int32_t>& place) {
        const Index n = order.size();
        std::fill_n(diagonal, n * size, 0.0);
        std::vector<double> column(n * size);
        std::vector<Index> at(n);                        // of each column, the next entry to use
        std::vector<std::int32_t> first(n, -1), next(n);  // for each row, the columns whose next entry is in it
        const auto enter = [&](Index k) {
            if (at[k] == starts[k + 1]) return;
            next[k] = first[rows[at[k]]];
            first[rows[at[k]]] = static_cast<std::int32_t>(k);
        };
        for (Index j = 0; j < n; ++j) {
            for (Index e = starts[j]; e < starts[j + 1]; ++e)
                std::fill_n(&column[rows[e] * size], size, 0.0);
            double* pivot = &diagonal[j * size];
            for (Index e = row_starts[order[j]]; e < row_starts[order[j] + 1]; ++e) {
                const Index i = place[columns[e]];
                const double* block = blocks.data() + e * size;
                if (i == j) std::copy_n(block, size, pivot);
                if (i <= j) continue;
                for (int r = 0; r < d; ++r)  // H is symmetric: the block of row j, transposed
                    for (int c = 0; c < d; ++c) column[i * size + r * d + c] = block[c * d + r];
            }
            for (std::int32_t k = first[j], after; k >= 0; k = after) {
                after = next[k];
                const double* here = &below[at[k] * size];
                subtract_product<d>(pivot, here, here);
                for (Index e = at[k] + 1; e < starts[k + 1]; ++e)
                    subtract_product<d>(&column[rows[e] * size], &below[e * size], here);
                ++at[k];
                enter(k);
            }
            if (!factorize<d>(pivot)) return false;
            for (Index e = starts[j]; e < starts[j + 1]; ++e) {
                double* block = &below[e * size];
                std::copy_n(&column[rows[e] * size], size, block);
                divide<d>(block, pivot);
            }
            at[j] = starts[j];
            enter(j);
        }
        return true;
    }

    /// Solves L Lᵀ x = y: y becomes x, both (f, d) in the order of elimination; with numbers, or with Quads of one
    /// system in each lane.
    template <class T>
    void solve(std::vector<T>& y) const {
        const Index n = starts.size() - 1;
        for (Index j = 0; j < n; ++j) {
            const double* pivot = &diagonal[j * size];
            T* here = &y[j * d];
            for (int i = 0; i < d; ++i) {
                for (int k = 0; k < i; ++k) here[i] -= pivot[i * d + k] * here[k];
                here[i] /= pivot[i * d + i];
            }
            for (Index e = starts[j]; e < starts[j + 1]; ++e)
                for (int i = 0; i < d; ++i)
                    for (int k = 0; k < d; ++k) y[rows[e] * d + i] -= below[e * size + i * d + k] * here[k];
        }
        for (Index j = n - 1; j >= 0; --j) {
            const double* pivot = &diagonal[j * size];
            T* here = &y[j * d];
            for (Index e = starts[j]; e < starts[j + 1]; ++e)
                for (int i = 0; i < d; ++i)
                    for (int k = 0; k < d; ++k) here[k] -= below[e * size + i * d + k] * y[rows[e] * d + i];
            for (int i = d - 1; i >= 0; --i) {
                for (int k = i + 1; k < d; ++k) here[i] -= pivot[k * d + i] * here[k];
                here[i] /= pivot[i * d + i];
            }
        }
    }
};

std::vector<std::int32_t> places_in(Vector<const std::int32_t> order) {
    std::vector<std::int32_t> place(order.size(), -1);
    for (Index i = 0; i < order.size(); ++i) place[order[i]] = static_cast<std::int32_t>(i);
    return place;
}

/// The place of each node in the order of elimination; checks that the factor's arrays fit each other.
std::vector<std::int32_t> require_factor(Vector<const std::int32_t> order, Vector<const Index> starts,
                                         Vector<const std::int32_t> rows, Cube<const double> diagonal,
                                         Cube<const double> below, Index d) {
    const Index n = order.size();
    require(starts.size() == n + 1, "starts: expected one more than order");
    require_starts(starts, rows.size(), "starts: expected to ascend up to all rows");
    require_below(rows, n, "rows: expected numbers of nodes");
    require_below(order, n, "order: expected numbers of nodes");
    require(diagonal.shape() == std::array{n, d, d}, "diagonal: expected shape (f, d, d)");
    require(below.shape() == std::array{rows.size(), d, d}, "below: expected shape (r, d, d)");
    std::vector<std::int32_t> place = places_in(order);
    require(std::find(place.begin(), place.end(), -1) == place.end(), "order: expected every node once");
    return place;
}

}  // namespace

std::tuple<Owned<std::int32_t, 1>, Owned<Index, 1>, Owned<std::int32_t, 1>> elimination(
    Vector<const Index> row_starts, Vector<const std::int32_t> columns, Matrix<const double> places) {
    const Index n = places.shape(0);
    require(row_starts.size() == n + 1, "row_starts: expected one more than places");
    require_system(row_starts, columns);
    std::vector<std::int32_t> nodes(n);
    std::iota(nodes.begin(), nodes.end(), 0);
    Dissection dissection{row_starts, columns, places, {}, std::vector<char>(n)};
    dissection.order.reserve(n);
    dissection.cut(nodes.data(), nodes.data() + n);
    const std::vector<std::int32_t>& order = dissection.order;
    const std::vector<std::int32_t> place = places_in({order.data(), {n}});

    // The rows of a column are those of H, and those of the columns whose first row is this column.
    std::vector<Index> starts(1, 0);
    std::vector<std::int32_t> rows, first(n, -1), next(n, -1), seen(n, -1);
    for (Index j = 0; j < n; ++j) {
        const auto begin = static_cast<Index>(rows.size());
        const auto add = [&](std::int32_t i) {
            if (i <= j || seen[i] == j) return;
            seen[i] = static_cast<std::int32_t>(j);
            rows.push_back(i);
        };
        for (Index e = row_starts[order[j]]; e < row_starts[order[j] + 1]; ++e) add(place[columns[e]]);
        for (std::int32_t k = first[j]; k >= 0; k = next[k])
            for (Index e = starts[k]; e < starts[k + 1]; ++e) add(rows[e]);
        std::sort(rows.begin() + begin, rows.end());
        starts.push_back(static_cast<Index>(rows.size()));
        if (begin == starts.back()) continue;
        next[j] = first[rows[begin]];
        first[rows[begin]] = static_cast<std::int32_t>(j);
    }
    return {owned(std::vector(order)), owned(std::move(starts)), owned(std::move(rows))};
}

bool block_cholesky(Vector<const Index> row_starts, Vector<const std::int32_t> columns, Cube<const double> blocks,
                    Vector<const std::int32_t> order, Vector<const Index> starts, Vector<const std::int32_t> rows,
                    Cube<double> diagonal, Cube<double> below) {
    const Index n = order.size(), d = blocks.shape(1);
    require(row_starts.size() == n + 1, "row_starts: expected one more than order");
    require_system(row_starts, columns);
    require(blocks.shape() == std::array{columns.size(), d, d}, "blocks: expected shape (b, d, d)");
    const std::vector<std::int32_t> place = require_factor(order, starts, rows, diagonal, below, d);
    return with_dimension(d, [&](auto dimension) {
        return Factor<dimension>{starts, rows, diagonal.data(), below.data()}.compute(row_starts, columns, blocks, order,
                                                                                     place);
    });
}

void block_cholesky_solve(Vector<const std::int32_t> order, Vector<const Index> starts, Vector<const std::int32_t> rows,
                          Cube<double> diagonal, Cube<double> below, Matrix<const double> right, Matrix<double> x) {
    const Index n = right.shape(0), d = diagonal.shape(1), k = right.shape(1);
    require(order.size() == n, "order: expected one for each row of right");
    require(x.shape() == right.shape(), "x: expected right's shape");
    require(d == 1 || d == k, "diagonal: expected blocks of numbers, or as large as a row of right");
    require_factor(order, starts, rows, diagonal, below, d);
    if (d == 1) {
        const Factor<1> factor{starts, rows, diagonal.data(), below.data()};
        std::vector<Quad> y(n);
        for (Index first = 0; first < k; first += 4) {
            const Index count = std::min<Index>(4, k - first);
            for (Index i = 0; i < n; ++i)
                for (Index c = 0; c < count; ++c) y[i][c] = right(order[i], first + c);
            factor.solve(y);
            for (Index i = 0; i < n; ++i)
                for (Index c = 0; c < count; ++c) x(order[i], first + c) = y[i][c];
        }
        return;
    }
    with_dimension(d, [&](auto dimension) {
        std::vector<double> y(n * d);
        for (Index i = 0; i < n; ++i)
            for (Index c = 0; c < d; ++c) y[i * d + c] = right(order[i], c);
        Factor<dimension>{starts, rows, diagonal.data(), below.data()}.solve(y);
        for (Index i = 0; i < n; ++i)
            for (Index c = 0; c < d; ++c) x(order[i], c) = y[i * d + c];
    });
}

}  // namespace mesh_motion
