#include "correction/sparse.h"

#include <cmath>

#include "interpolation/basis.h"
#include "lanes.h"
#include "parallel.h"

namespace mesh_motion {
namespace {

constexpr Index rows_of_product = 1 << 10, rows_of_vectors = 1 << 13;

/// Columns first … first + K − 1 of one row of a product.
template <int K>
void row_product(Vector<const std::int32_t> columns, Vector<const double> entries, Matrix<const double> vectors,
                 Index begin, Index end, Index first, double* product) {
    std::array<double, K> even{}, odd{};
    const auto add = [&](Index e, std::array<double, K>& sum) {
        const double* from = vectors.data() + columns[e] * vectors.shape(1) + first;
        for (int m = 0; m < K; ++m) sum[m] += entries[e] * from[m];
    };
    Index e = begin;
    for (; e + 1 < end; e += 2) {
        add(e, even);
        add(e + 1, odd);
    }
    if (e < end) add(e, even);
    for (int m = 0; m < K; ++m) product[first + m] = even[m] + odd[m];
}

}  // namespace

void sparse_product(Vector<const std::int32_t> pointers, Vector<const std::int32_t> columns,
                    Vector<const double> entries, Matrix<const double> vectors, Matrix<double> product) {
    const Index n = product.shape(0), k = product.shape(1);
    require(pointers.size() == n + 1 && pointers[n] == entries.size() && columns.size() == entries.size(),
            "pointers: expected one more than rows, the last one of all entries");
    require(vectors.shape(1) == k, "product: expected as many columns as vectors");
    for_ranges(n, rows_of_product, [&](Index first, Index last) {
        for (Index i = first; i < last; ++i) {
            const auto part = [&]<int K>(std::integral_constant<int, K>, Index column) {
                row_product<K>(columns, entries, vectors, pointers[i], pointers[i + 1], column, &product(i, 0));
            };
            Index column = 0;
            for (; column + 4 <= k; column += 4) part(std::integral_constant<int, 4>{}, column);
            for (; column < k; ++column) part(std::integral_constant<int, 1>{}, column);
        }
    });
}

Owned<double, 1> column_products(Matrix<const double> a, Matrix<const double> b) {
    require(a.shape() == b.shape(), "b: expected the shape of a");
    const Index n = a.shape(0), k = a.shape(1), blocks = (n + rows_of_vectors - 1) / rows_of_vectors;
    std::vector<double> parts(blocks * k), sums(k);
    for_ranges(n, rows_of_vectors, [&](Index first, Index last) {
        double* part = parts.data() + first / rows_of_vectors * k;
        for (Index i = first; i < last; ++i)
            for (Index c = 0; c < k; ++c) part[c] += a(i, c) * b(i, c);
    });
    for (Index i = 0; i < blocks * k; ++i) sums[i % k] += parts[i];
    return owned(std::move(sums));
}

void advance_columns(Matrix<double> x, Matrix<double> r, Matrix<const double> p, Matrix<const double> q,
                     Vector<const double> alpha) {
    require(r.shape() == x.shape() && p.shape() == x.shape() && q.shape() == x.shape() && alpha.size() == x.shape(1),
            "expected vectors of one shape, and one number a column");
    for_ranges(x.shape(0), rows_of_vectors, [&](Index first, Index last) {
        for (Index i = first; i < last; ++i)
            for (Index c = 0; c < alpha.size(); ++c) {
                x(i, c) += alpha[c] * p(i, c);
                r(i, c) -= alpha[c] * q(i, c);
            }
    });
}

void redirect_columns(Matrix<double> p, Matrix<const double> z, Vector<const double> beta) {
    require(z.shape() == p.shape() && beta.size() == p.shape(1),
            "expected vectors of one shape, and one number a column");
    for_ranges(p.shape(0), rows_of_vectors, [&](Index first, Index last) {
        for (Index i = first; i < last; ++i)
            for (Index c = 0; c < beta.size(); ++c) p(i, c) = z(i, c) + beta[c] * p(i, c);
    });
}

void sparse_inverse_rows(int code, Matrix<const double> points, Matrix<const Index> neighbours, double inverse_radius,
                         Matrix<double> rows) {
    const Index n = neighbours.shape(0), count = neighbours.shape(1), width = count + 1;
    require(points.shape() == std::array{n, Index{3}}, "points: expected shape (n, 3)");
    require(rows.shape() == std::array{n, width}, "rows: expected shape (n, count + 1)");
    for (Index j : neighbours) require(j < n, "neighbours: expected numbers of points");
    const Index rows_of_task = 1 + 1'000'000 / (width * width * width);
    with_basis(code, [&](auto basis) {
        for_ranges(n, rows_of_task, [&](Index first, Index last) {
            std::vector<double> factor(width * width), at(3 * width);
            for (Index i = first; i < last; ++i) {
                // farthest first, the point itself last: its row of the inverse factor is then one back-substitution
                Index m = 0;
                while (m < count && neighbours(i, m) >= 0) ++m;
                for (Index j = 0; j <= m; ++j)
                    for (Index axis = 0; axis < 3; ++axis)
                        at[axis * width + j] = points(j < m ? neighbours(i, m - 1 - j) : i, axis);
                double *x = at.data(), *y = x + width, *z = y + width, *g = &rows(i, 0);
                for (Index j = 0; j <= m; ++j)
                    for (Index c = j; c <= m; ++c) {
                        const double dx = x[j] - x[c], dy = y[j] - y[c], dz = z[j] - z[c];
                        factor[j * width + c] = basis.phi(std::sqrt(dx * dx + dy * dy + dz * dz) * inverse_radius);
                    }
                // Cholesky by rows of the upper factor
                for (Index j = 0; j <= m; ++j) {
                    double* row = &factor[j * width];
                    // a rounded-away pivot only weakens the preconditioner: keep it positive
                    const double pivot = std::sqrt(std::max(row[j], 1e-14));
                    for (Index c = j; c <= m; ++c) row[c] = c == j ? pivot : row[c] / pivot;
                    for (Index r = j + 1; r <= m; ++r) {
                        double* __restrict below = &factor[r * width];
                        for (Index c = r; c <= m; ++c) below[c] -= row[r] * row[c];
                    }
                }
                g[m] = 1.0 / factor[m * width + m];
                for (Index j = m - 1; j >= 0; --j) {
                    const double* row = &factor[j * width];
                    g[j] = -sum_in_lanes(j + 1, m + 1, [&](Index c) { return row[c] * g[c]; }) / row[j];
                }
            }
        });
    });
}

}  // namespace mesh_motion
