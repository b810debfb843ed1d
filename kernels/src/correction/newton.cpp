#include "correction/newton.h"

#include <algorithm>
#include <numeric>

#include "parallel.h"

namespace mesh_motion {
namespace {

constexpr Index rows_of_task = 1 << 10;

/// Sum over blocks of rows, in order, of f(first, last).
template <class F>
double sum_of_blocks(Index n, F&& f) {
    std::vector<double> parts((n + rows_of_task - 1) / rows_of_task);
    for_ranges(n, rows_of_task, [&](Index first, Index last) { parts[first / rows_of_task] = f(first, last); });
    return std::accumulate(parts.begin(), parts.end(), 0.0);
}

template <int d>
using Block = std::array<std::array<double, d>, d>;

template <int d>
struct System {
    Vector<const Index> row_starts;
    Vector<const std::int32_t> columns;
    Cube<const double> blocks;

    Index size() const { return row_starts.size() - 1; }

    double multiply(const double* x, double* product) const {
        return sum_of_blocks(size(), [&](Index first, Index last) {
            double energy = 0.0;
            for (Index i = first; i < last; ++i) {
                std::array<double, d> sum{};
                for (Index e = row_starts[i]; e < row_starts[i + 1]; ++e) {
                    const double *block = blocks.data() + e * d * d, *from = x + Index{columns[e]} * d;
                    for (int r = 0; r < d; ++r)
                        for (int q = 0; q < d; ++q) sum[r] += block[r * d + q] * from[q];
                }
                for (int r = 0; r < d; ++r) {
                    product[i * d + r] = sum[r];
                    energy += sum[r] * x[i * d + r];
                }
            }
            return energy;
        });
    }

    /// Inverse of the diagonal's block of row i.
    Block<d> inverse(Index i) const {
        const double* a = blocks.data() + row_starts[i] * d * d;
        if constexpr (d == 1) {
            return {{{1.0 / a[0]}}};
        } else if constexpr (d == 2) {
            const double det = a[0] * a[3] - a[1] * a[2];
            return {{{a[3] / det, -a[1] / det}, {-a[2] / det, a[0] / det}}};
        } else {
            Block<3> out;
            double det = 0.0;
            for (int k = 0; k < 3; ++k) {
                const int k1 = (k + 1) % 3, k2 = (k + 2) % 3;
                for (int r = 0; r < 3; ++r) {
                    const int r1 = (r + 1) % 3, r2 = (r + 2) % 3;
                    out[k][r] = a[r1 * 3 + k1] * a[r2 * 3 + k2] - a[r1 * 3 + k2] * a[r2 * 3 + k1];
                }
                det += a[k] * out[k][0];
            }
            for (auto& row : out)
                for (double& value : row) value /= det;
            return out;
        }
    }

    int solve(Vector<const double> right, double tolerance, int most, double* x) const {
        std::vector<double> residual(right.begin(), right.end()), z(right.size()), p(right.size()), hp(right.size());
        std::vector<Block<d>> inverses(size());
        for_ranges(size(), rows_of_task, [&](Index first, Index last) {
            for (Index i = first; i < last; ++i) inverses[i] = inverse(i);
        });
        /// x += α p, residual −= α H p, z = the preconditioned residual; returns residual · z.
        const auto advance = [&](double alpha) {
            return sum_of_blocks(size(), [&](Index first, Index last) {
                double sum = 0.0;
                for (Index k = first * d; k < last * d; ++k) {
                    x[k] += alpha * p[k];
                    residual[k] -= alpha * hp[k];
                }
                for (Index i = first; i < last; ++i)
                    for (int r = 0; r < d; ++r) {
                        double value = 0.0;
                        for (int k = 0; k < d; ++k) value += inverses[i][r][k] * residual[i * d + k];
                        z[i * d + r] = value;
                        sum += value * residual[i * d + r];
                    }
                return sum;
            });
        };
        double rho = advance(0.0);
        const double stop = tolerance * tolerance * rho;
        p = z;
        for (int done = 1; done <= most; ++done) {
            const double bend = multiply(p.data(), hp.data());
            if (!(bend > 0.0)) return done - 1;
            const double previous = std::exchange(rho, advance(rho / bend));
            if (!(rho > stop)) return done;
            for_ranges(right.size(), rows_of_task * d, [&](Index first, Index last) {
                for (Index k = first; k < last; ++k) p[k] = z[k] + rho / previous * p[k];
            });
        }
        return most;
    }
};

/// f(system) of the right dimension.
template <class F>
auto with_system(Vector<const Index> row_starts, Vector<const std::int32_t> columns, Cube<const double> blocks,
                 const std::array<Index, 2>& shape, F&& f) {
    require(blocks.shape() == std::array{columns.size(), shape[1], shape[1]}, "blocks: expected shape (b, d, d)");
    require(row_starts.size() == shape[0] + 1 && row_starts[shape[0]] == columns.size(),
            "row_starts: expected a number more than rows, the last one of all columns");
    return with_dimension(shape[1], [&](auto d) { return f(System<d>{row_starts, columns, blocks}); });
}

}  // namespace

double block_product(Vector<const Index> row_starts, Vector<const std::int32_t> columns, Cube<const double> blocks,
                     Matrix<const double> x, Matrix<double> product) {
    require(product.shape() == x.shape(), "product: expected the shape of x");
    return with_system(row_starts, columns, blocks, x.shape(),
                       [&](const auto& system) { return system.multiply(x.data(), product.data()); });
}

int block_conjugate_gradients(Vector<const Index> row_starts, Vector<const std::int32_t> columns,
                              Cube<const double> blocks, Matrix<const double> right, double tolerance, int most,
                              Matrix<double> x) {
    require(x.shape() == right.shape(), "x: expected the shape of right");
    std::fill(x.begin(), x.end(), 0.0);
    return with_system(row_starts, columns, blocks, x.shape(), [&](const auto& system) {
        return system.solve({right.data(), {right.size()}}, tolerance, most, x.data());
    });
}

std::tuple<Owned<Index, 1>, Owned<std::int32_t, 1>, Owned<Index, 1>> linked_pattern(
    Vector<const Index> row_starts, Vector<const std::int32_t> columns, Vector<const Index> targets,
    Vector<const Index> order, Index n_roots) {
    const Index n = targets.size();
    require(row_starts.size() == n + 1 && row_starts[n] == columns.size() && order.size() == n,
            "row_starts, order: expected (f + 1) and (f)");
    require(std::all_of(targets.begin(), targets.end(), [&](Index t) { return 0 <= t && t < n_roots; }) &&
                std::all_of(order.begin(), order.end(), [&](Index i) { return 0 <= i && i < n; }) &&
                std::all_of(columns.begin(), columns.end(), [&](Index i) { return 0 <= i && i < n; }),
            "targets, order, columns: expected numbers of representatives and of nodes");
    std::vector<Index> starts(n_roots + 1), slots(columns.size()), where(n_roots, -1);
    std::vector<std::int32_t> found;
    Index at = 0;
    for (Index root = 0; root < n_roots; ++root) {
        const auto slot = [&](Index column) {
            if (where[column] < starts[root]) {
                where[column] = static_cast<Index>(found.size());
                found.push_back(static_cast<std::int32_t>(column));
            }
            return where[column];
        };
        slot(root);
        for (; at < n && targets[order[at]] == root; ++at)
            for (Index e = row_starts[order[at]]; e < row_starts[order[at] + 1]; ++e)
                slots[e] = slot(targets[columns[e]]);
        starts[root + 1] = static_cast<Index>(found.size());
    }
    return {owned(std::move(starts)), owned(std::move(found)), owned(std::move(slots))};
}

void add_linked_blocks(Vector<const Index> rows, Vector<const Index> columns, Vector<const Index> slots,
                       Cube<const double> matrices, Cube<const double> blocks, Cube<double> sums) {
    const Index n = slots.size(), d = matrices.shape(1);
    require(rows.size() == n && columns.size() == n, "rows, columns: expected one a slot");
    require(blocks.shape() == std::array{n, d, d} && matrices.shape(2) == d && sums.shape(1) == d && sums.shape(2) == d,
            "blocks, matrices, sums: expected d × d matrices");
    with_dimension(d, [&](auto dimension) {
        constexpr int d = dimension;
        for (Index e = 0; e < n; ++e)
            for (int i = 0; i < d; ++i)
                for (int j = 0; j < d; ++j) {
                    double sum = 0.0;
                    for (int k = 0; k < d; ++k) {
                        double half = 0.0;
                        for (int l = 0; l < d; ++l) half += blocks(e, k, l) * matrices(columns[e], l, j);
                        sum += matrices(rows[e], k, i) * half;
                    }
                    sums(slots[e], i, j) += sum;
                }
    });
}

}  // namespace mesh_motion
