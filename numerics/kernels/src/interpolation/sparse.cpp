#include "interpolation/sparse.h"

#include <cmath>

#include "interpolation/basis.h"
#include "lanes.h"
#include "parallel.h"
#include "quad.h"

namespace mesh_motion {
namespace {

constexpr Index products = 1 << 16;  // of one task, on average
constexpr Index ahead = 8;          // rows that are prefetched
constexpr Index rows_of_block = 1 << 10, rows_of_vectors = 1 << 13;

using Quads = std::vector<Quad>;

/// A matrix in compressed rows, and its product with vectors whose rows are `groups` registers.
class SparseRows {
  public:
    SparseRows(Vector<const std::int32_t> pointers, Vector<const std::int32_t> columns, Vector<const double> entries,
               Index rows, Index length)
        : pointers_(pointers.data()), columns_(columns.data()), entries_(entries.data()) {
        require(pointers.size() == rows + 1 && columns.size() == entries.size(),
                "pointers, columns: expected (r + 1,), (e,)");
        bool known = 0 <= pointers[0] && pointers[rows] <= entries.size();
        for (Index i = 0; i < rows; ++i) known &= pointers[i] <= pointers[i + 1];
        require(known, "pointers: expected numbers of entries, ascending");
        require_below(columns, length, "columns: expected numbers of rows of the vectors");
    }

    bool empty(Index i) const { return pointers_[i] == pointers_[i + 1]; }

    /// sum = Σ_e entries[e] vectors[columns[e]] of row i, for one group.
    void multiply(Index i, const Quad* __restrict vectors, Index groups, Quad& sum) const {
        Quad even{}, odd{};  // separate sums: a single one would wait for each product
        const Index last = pointers_[i + 1];
        Index e = pointers_[i];
        for (; e + 1 < last; e += 2) {
            even += entries_[e] * vectors[columns_[e] * groups];
            odd += entries_[e + 1] * vectors[columns_[e + 1] * groups];
        }
        if (e < last) even += entries_[e] * vectors[columns_[e] * groups];
        sum = even + odd;
    }

    /// vectors[columns[e]] += entries[e] weight of row i, for one group.
    void count(Index i, const Quad& weight, Index groups, Quad* __restrict vectors) const {
        for (Index e = pointers_[i]; e < pointers_[i + 1]; ++e) vectors[columns_[e] * groups] += entries_[e] * weight;
    }

  private:
    const std::int32_t *pointers_, *columns_;
    const double* entries_;
};

Index groups_of(Index k) { return (k + 3) / 4; }

/// Rows of whole registers, padded with zeros.
Quads in_quads(Matrix<const double> vectors) {
    const Index n = vectors.shape(0), k = vectors.shape(1), groups = groups_of(k);
    Quads out(n * groups);
    for (Index j = 0; j < n; ++j)
        for (Index c = 0; c < k; ++c) out[j * groups + c / 4][c % 4] = vectors(j, c);
    return out;
}

void from_quads(const Quads& vectors, Matrix<double> out) {
    const Index n = out.shape(0), k = out.shape(1), groups = groups_of(k);
    for (Index j = 0; j < n; ++j)
        for (Index c = 0; c < k; ++c) out(j, c) = vectors[j * groups + c / 4][c % 4];
}

/// a / b column by column; 0 in a column that is solved.
Quads ratios(const Quads& a, const Quads& b) {
    Quads out(a.size());
    for (std::size_t g = 0; g < a.size(); ++g)
        for (int c = 0; c < 4; ++c) out[g][c] = b[g][c] > 0.0 ? a[g][c] / b[g][c] : 0.0;
    return out;
}

/// Calls f(i, g, sum) for all groups of all rows, block by block; returns what f adds to sum, for each group.
template <class F>
Quads sums_of_rows(Index n, Index groups, F&& f) {
    Quads parts((n + rows_of_block - 1) / rows_of_block * groups), total(groups);
    for_ranges(n, rows_of_block, [&](Index first, Index last) {
        Quads sums(groups);
        for (Index i = first; i < last; ++i)
            for (Index g = 0; g < groups; ++g) f(i, g, sums[g]);
        std::copy(sums.begin(), sums.end(), parts.begin() + first / rows_of_block * groups);
    });
    for (std::size_t part = 0; part < parts.size(); ++part) total[part % groups] += parts[part];
    return total;
}

}  // namespace

void add_product(Vector<const Index> rows, Vector<const std::int32_t> pointers, Vector<const std::int32_t> columns,
                 Vector<const double> entries, Matrix<const double> weights, Matrix<double> out) {
    const Index n = rows.size(), k = out.shape(1), groups = groups_of(k);
    require(weights.shape(1) == k, "weights: expected as many columns as in out");
    const SparseRows matrix(pointers, columns, entries, n, weights.shape(0));
    require_below(rows, out.shape(0), "rows: expected numbers of rows of out");
    const Quads vectors = in_quads(weights);
    const Index rows_of_a_task = std::max<Index>(1, products * n / std::max<Index>(1, entries.size()));
    for_ranges(n, rows_of_a_task, [&](Index begin, Index end) {
        for (Index i = begin; i < end; ++i) {
            // consecutive rows are neighbours in space, but not in memory
            if (i + ahead < end) __builtin_prefetch(&out(rows[i + ahead], 0), 1);
            if (matrix.empty(i)) continue;
            for (Index g = 0; g < groups; ++g) {
                Quad sum;
                matrix.multiply(i, vectors.data() + g, groups, sum);
                for (Index c = 4 * g; c < std::min(4 * g + 4, k); ++c) out(rows[i], c) += sum[c - 4 * g];
            }
        }
    });
}

void transposed_product(Vector<const Index> rows, Vector<const std::int32_t> pointers,
                        Vector<const std::int32_t> columns, Vector<const double> entries, Matrix<const double> weights,
                        Matrix<double> out) {
    const Index n = rows.size(), k = weights.shape(1), groups = groups_of(k);
    require(out.shape(1) == k, "out: expected as many columns as in weights");
    const SparseRows matrix(pointers, columns, entries, n, out.shape(0));
    require_below(rows, weights.shape(0), "rows: expected numbers of rows of weights");
    Quads sums(out.shape(0) * groups);
    for (Index i = 0; i < n; ++i) {
        if (i + ahead < n) __builtin_prefetch(&weights(rows[i + ahead], 0));
        for (Index g = 0; g < groups; ++g) {
            Quad weight{};
            for (Index c = 4 * g; c < std::min(4 * g + 4, k); ++c) weight[c - 4 * g] = weights(rows[i], c);
            matrix.count(i, weight, groups, sums.data() + g);
        }
    }
    from_quads(sums, out);
}

Index solve_sparse(Vector<const std::int32_t> pointers, Vector<const std::int32_t> columns,
                   Vector<const double> entries, Vector<const std::int32_t> factor_pointers,
                   Vector<const std::int32_t> factor_columns, Vector<const double> factor_entries,
                   Vector<const std::int32_t> transposed_pointers, Vector<const std::int32_t> transposed_columns,
                   Vector<const double> transposed_entries, double limit, Index most, Matrix<double> residual,
                   Matrix<double> solution) {
    const Index n = residual.shape(0), groups = groups_of(residual.shape(1));
    require(solution.shape() == residual.shape(), "solution: expected the shape of residual");
    require(0 < most && most <= 10'000, "most: expected 1 to 10 000 iterations");
    const SparseRows matrix(pointers, columns, entries, n, n);
    const SparseRows factor(factor_pointers, factor_columns, factor_entries, n, n);
    const SparseRows transposed(transposed_pointers, transposed_columns, transposed_entries, n, n);
    Quads r = in_quads(residual), x(r.size()), p(r.size()), q(r.size()), t(r.size()), z(r.size()), rz(groups);
    for (Index iteration = 1;; ++iteration) {
        sums_of_rows(n, groups, [&](Index i, Index g, Quad&) {
            factor.multiply(i, r.data() + g, groups, t[i * groups + g]);
        });
        const Quads now = sums_of_rows(n, groups, [&](Index i, Index g, Quad& sum) {
            const Index at = i * groups + g;
            transposed.multiply(i, t.data() + g, groups, z[at]);
            sum += r[at] * z[at];
        });
        const Quads beta = ratios(now, rz);
        sums_of_rows(n, groups, [&](Index i, Index g, Quad&) {
            const Index at = i * groups + g;
            p[at] = z[at] + beta[g] * p[at];
        });
        const Quads pq = sums_of_rows(n, groups, [&](Index i, Index g, Quad& sum) {
            const Index at = i * groups + g;
            matrix.multiply(i, p.data() + g, groups, q[at]);
            sum += p[at] * q[at];
        });
        const Quads alpha = ratios(now, pq);
        std::vector<double> largest(1 + n / rows_of_block);
        for_ranges(n, rows_of_block, [&](Index first, Index last) {
            double most_left[4] = {};
            for (Index at = first * groups; at < last * groups; ++at) {
                const Index g = at % groups;
                x[at] += alpha[g] * p[at];
                r[at] -= alpha[g] * q[at];
                for (int c = 0; c < 4; ++c) most_left[c] = std::max(most_left[c], std::abs(r[at][c]));
            }
            largest[first / rows_of_block] = *std::max_element(most_left, most_left + 4);
        });
        rz = now;
        if (iteration < most && *std::max_element(largest.begin(), largest.end()) > limit) continue;
        from_quads(x, solution);
        from_quads(r, residual);
        return iteration;
    }
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
                // farthest first, the point itself last: then its row of the inverse factor is one back-substitution
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
                // Cholesky factorization by rows of the upper factor
                for (Index j = 0; j <= m; ++j) {
                    double* row = &factor[j * width];
                    // a pivot that is lost in rounding only weakens the preconditioner: keep it positive
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
