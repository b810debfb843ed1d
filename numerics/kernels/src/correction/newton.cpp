#include "correction/newton.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numeric>

#include "lanes.h"
#include "parallel.h"
#include "quad.h"

namespace mesh_motion {
namespace {

constexpr Index rows_of_task = 1 << 10;

/// Sum of f(first, last) over blocks of rows, in order.
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
                const std::array<double, d> sum = row(i, x);
                for (int r = 0; r < d; ++r) {
                    product[i * d + r] = sum[r];
                    energy += sum[r] * x[i * d + r];
                }
            }
            return energy;
        });
    }

    /// The product of row i and x.
    std::array<double, d> row(Index i, const double* x) const {
        std::array<double, d> sum{};
        using Two [[gnu::vector_size(2 * sizeof(double))]] = double;
        [[maybe_unused]] Two both{};
        for (Index e = row_starts[i]; e < row_starts[i + 1]; ++e) {
            const double *block = blocks.data() + e * d * d, *from = x + Index{columns[e]} * d;
            if constexpr (d == 2) {  // a block fits a register; for nine numbers scalar code is faster
                Quad whole;
                std::memcpy(&whole, block, sizeof whole);
                const Quad products = whole * Quad{from[0], from[1], from[0], from[1]};
                both += __builtin_shufflevector(products, products, 0, 2);
                both += __builtin_shufflevector(products, products, 1, 3);
            } else {
                for (int r = 0; r < d; ++r)
                    for (int q = 0; q < d; ++q) sum[r] += block[r * d + q] * from[q];
            }
        }
        if constexpr (d == 2) sum = {both[0], both[1]};
        return sum;
    }

    /// Inverse of the diagonal block of row i.
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
};

/// The Hessian of aggregates that move as rigid units, Pᵀ H P = L Lᵀ: it couples distant nodes in one step of the
/// conjugate gradients. Rows of L begin with their first entry.
template <int d>
class Coarse {
public:
    Coarse(const System<d>& system, Vector<const std::int32_t> aggregates) : aggregates_(aggregates) {
        const Index f = system.size(), m = f ? *std::max_element(aggregates.begin(), aggregates.end()) + 1 : 0;
        starts_.resize(m + 1);
        members_.resize(f);
        for (std::int32_t k : aggregates) ++starts_[k + 1];
        std::partial_sum(starts_.begin(), starts_.end(), starts_.begin());
        std::vector<Index> next(starts_.begin(), starts_.end() - 1), lowest(next);
        for (Index i = 0; i < f; ++i) members_[next[aggregates[i]]++] = i;
        for_ranges(m, aggregates_of_task, [&](Index first, Index last) {
            for (Index k = first; k < last; ++k) {
                Index least = k;
                of_blocks(system, k, [&](Index other, const double*) { least = std::min(least, other); });
                lowest[k] = least;
            }
        });
        Index entries = 0;
        for (Index r = 0; r < m * d; ++r) {
            first_.push_back(lowest[r / d] * d);
            place_.push_back(entries - first_[r]);
            entries += r + 1 - first_[r];
        }
        factor_.resize(entries);
        inverses_.resize(m * d);
        sums_.resize(m * d);
        for_ranges(m, aggregates_of_task, [&](Index first, Index last) {
            for (Index k = first; k < last; ++k) {
                Block<d> own{};
                of_blocks(system, k, [&](Index other, const double* block) {
                    if (other == k) {
                        for (int r = 0; r < d; ++r)
                            for (int q = 0; q < d; ++q) own[r][q] += block[r * d + q];
                    } else if (other < k) {
                        for (int r = 0; r < d; ++r) {
                            double* out = factor_.data() + (place_[k * d + r] + other * d);
                            for (int q = 0; q < d; ++q) out[q] += block[r * d + q];
                        }
                    }
                });
                for (int r = 0; r < d; ++r) std::copy_n(own[r].begin(), r + 1, &factor_[place_[k * d + r] + k * d]);
            }
        });
        factorize();
    }

    /// Solves L Lᵀ c = Pᵀ residual for the steps c of the aggregates; returns cᵀ Pᵀ residual.
    double solve(const double* residual) {
        for_ranges(starts_.size() - 1, aggregates_of_task, [&](Index first, Index last) {
            for (Index k = first; k < last; ++k) {
                std::array<double, d> sum{};
                for (Index e = starts_[k]; e < starts_[k + 1]; ++e)
                    for (int r = 0; r < d; ++r) sum[r] += residual[members_[e] * d + r];
                std::copy(sum.begin(), sum.end(), &sums_[k * d]);
            }
        });
        const auto n = static_cast<Index>(sums_.size());
        double energy = 0.0;
        for (Index r = 0; r < n; ++r) {
            const double* row = factor_.data() + place_[r];
            const double known = sum_in_lanes(first_[r], r, [&](Index k) { return row[k] * sums_[k]; });
            sums_[r] = (sums_[r] - known) * inverses_[r];
            energy += sums_[r] * sums_[r];
        }
        for (Index r = n - 1; r >= 0; --r) {
            const double* row = factor_.data() + place_[r];
            sums_[r] *= inverses_[r];
            for (Index k = first_[r]; k < r; ++k) sums_[k] -= row[k] * sums_[r];
        }
        return energy;
    }

    /// The step of the aggregate of node i.
    const double* step(Index i) const { return sums_.data() + Index{aggregates_[i]} * d; }

private:
    static constexpr Index aggregates_of_task = 16;
    static constexpr double nothing = 1e-12;  // of the diagonal: smaller pivots are only rounding

    template <class F>
    void of_blocks(const System<d>& system, Index k, F&& f) const {
        for (Index m = starts_[k]; m < starts_[k + 1]; ++m)
            for (Index e = system.row_starts[members_[m]]; e < system.row_starts[members_[m] + 1]; ++e)
                f(Index{aggregates_[system.columns[e]]}, system.blocks.data() + e * d * d);
    }

    void factorize() {
        for (Index r = 0; r < static_cast<Index>(first_.size()); ++r) {
            double* row = factor_.data() + place_[r];
            for (Index c = first_[r]; c <= r; ++c) {
                const double* other = factor_.data() + place_[c];
                const double left = row[c] - sum_in_lanes(std::max(first_[r], first_[c]), c,
                                                          [&](Index k) { return row[k] * other[k]; });
                if (c < r)
                    row[c] = left * inverses_[c];
                else
                    inverses_[r] = left > nothing * row[r] ? 1.0 / std::sqrt(left) : 0.0;
            }
        }
    }

    Vector<const std::int32_t> aggregates_;
    std::vector<Index> starts_, members_, first_, place_;
    std::vector<double> factor_, inverses_, sums_;
};

template <int d>
int conjugate_gradients(const System<d>& system, Coarse<d> coarse, Vector<const double> right, double tolerance,
                        int most, double* x) {
    const Index n = system.size();
    std::vector<double> residual(right.begin(), right.end()), z(right.size()), p(right.size()), hp(right.size());
    std::vector<Block<d>> inverses(n);
    for_ranges(n, rows_of_task, [&](Index first, Index last) {
        for (Index i = first; i < last; ++i) inverses[i] = system.inverse(i);
    });
    /// x += α p, residual −= α H p; z and the coarse steps become its preconditioned form; returns their product.
    const auto advance = [&](double alpha) {
        const double fine = sum_of_blocks(n, [&](Index first, Index last) {
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
        return fine + coarse.solve(residual.data());
    };
    double rho = advance(0.0), beta = 0.0;
    const double stop = tolerance * tolerance * rho;
    for (int done = 1; done <= most; ++done) {
        for_ranges(n, rows_of_task, [&](Index first, Index last) {
            for (Index i = first; i < last; ++i)
                for (int r = 0; r < d; ++r) p[i * d + r] = z[i * d + r] + coarse.step(i)[r] + beta * p[i * d + r];
        });
        const double bend = system.multiply(p.data(), hp.data());
        if (!(bend > 0.0)) return done - 1;
        const double previous = std::exchange(rho, advance(rho / bend));
        if (!(rho > stop)) return done;
        beta = rho / previous;
    }
    return most;
}

/// Calls f(system) with a system of the right dimension.
template <class F>
auto with_system(Vector<const Index> row_starts, Vector<const std::int32_t> columns, Cube<const double> blocks,
                 const std::array<Index, 2>& shape, F&& f) {
    require(blocks.shape() == std::array{columns.size(), shape[1], shape[1]}, "blocks: expected shape (b, d, d)");
    require(row_starts.size() == shape[0] + 1, "row_starts: expected a number more than rows");
    require_starts(row_starts, columns.size(), "row_starts: expected to ascend up to all columns");
    require_below(columns, shape[0], "columns: expected numbers of rows");
    return with_dimension(shape[1], [&](auto d) { return f(System<d>{row_starts, columns, blocks}); });
}

}  // namespace

double block_product(Vector<const Index> row_starts, Vector<const std::int32_t> columns, Cube<const double> blocks,
                     Matrix<const double> x, Matrix<double> product) {
    require(product.shape() == x.shape(), "product: expected the shape of x");
    return with_system(row_starts, columns, blocks, x.shape(),
                       [&](const auto& system) { return system.multiply(x.data(), product.data()); });
}

Owned<std::int32_t, 1> node_aggregates(Vector<const Index> row_starts, Vector<const std::int32_t> columns,
                                       Index size) {
    const Index n = row_starts.size() - 1;
    require(size > 0, "size: expected a positive number");
    require_starts(row_starts, columns.size(), "row_starts: expected to ascend up to all columns");
    require_below(columns, n, "columns: expected numbers of nodes");
    std::vector<std::int32_t> found(n, -1);
    std::vector<Index> seeds, members;
    std::int32_t count = 0;
    const auto for_neighbours = [&](Index i, auto&& f) {
        for (Index e = row_starts[i]; e < row_starts[i + 1]; ++e) f(Index{columns[e]});
    };
    const auto grow = [&](Index seed) {
        members.assign(1, seed);
        found[seed] = count;
        for (std::size_t at = 0; at < members.size(); ++at)
            for_neighbours(members[at], [&](Index j) {
                if (found[j] >= 0 || static_cast<Index>(members.size()) == size) return;
                found[j] = count;
                members.push_back(j);
            });
        std::int32_t adjacent = -1;
        for (Index i : members)
            for_neighbours(i, [&](Index j) {
                if (found[j] < 0) seeds.push_back(j);
                if (found[j] >= 0 && found[j] != count) adjacent = found[j];
            });
        if (static_cast<Index>(members.size()) < size / 4 && adjacent >= 0)
            for (Index i : members) found[i] = adjacent;  // nodes left over between other aggregates
        else
            ++count;
    };
    std::size_t next = 0;
    for (Index i = 0; i < n; ++i) {
        if (found[i] < 0) seeds.push_back(i);
        for (; next < seeds.size(); ++next)
            if (found[seeds[next]] < 0) grow(seeds[next]);
    }
    return owned(std::move(found));
}

int block_conjugate_gradients(Vector<const Index> row_starts, Vector<const std::int32_t> columns,
                              Cube<const double> blocks, Vector<const std::int32_t> aggregates,
                              Matrix<const double> right, double tolerance, int most, Matrix<double> x) {
    require(x.shape() == right.shape(), "x: expected the shape of right");
    require(aggregates.size() == x.shape(0), "aggregates: expected one for each node");
    require_below(aggregates, x.shape(0), "aggregates: expected numbers of some");
    std::fill(x.begin(), x.end(), 0.0);
    return with_system(row_starts, columns, blocks, x.shape(), [&](const auto& system) {
        require(std::adjacent_find(row_starts.begin(), row_starts.end()) == row_starts.end(),
                "row_starts: expected the diagonal's block in each row");
        const Vector<const double> flat(right.data(), {right.size()});
        return conjugate_gradients(system, {system, aggregates}, flat, tolerance, most, x.data());
    });
}

std::tuple<Owned<Index, 1>, Owned<std::int32_t, 1>, Owned<Index, 1>> linked_pattern(
    Vector<const Index> row_starts, Vector<const std::int32_t> columns, Vector<const Index> targets,
    Vector<const Index> order, Index n_roots) {
    const Index n = targets.size();
    require(row_starts.size() == n + 1 && order.size() == n, "row_starts, order: expected (f + 1) and (f)");
    require_starts(row_starts, columns.size(), "row_starts: expected to ascend up to all columns");
    require(0 <= n_roots && n_roots <= n, "n_roots: expected no more than nodes");
    require_below(targets, n_roots, "targets: expected numbers of representatives");
    require_below(order, n, "order: expected numbers of nodes");
    require_below(columns, n, "columns: expected numbers of nodes");
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
    require_below(rows, matrices.shape(0), "rows: expected numbers of matrices");
    require_below(columns, matrices.shape(0), "columns: expected numbers of matrices");
    require_below(slots, sums.shape(0), "slots: expected numbers of sums");
    with_dimension(d, [&](auto dimension) {
        constexpr int d = dimension;
        std::vector<char> is_identity(matrices.shape(0));  // of nodes without a wall: nearly all
        for (Index m = 0; m < matrices.shape(0); ++m) {
            bool same = true;
            for (int i = 0; i < d * d; ++i) same &= matrices[m].data()[i] == (i % (d + 1) ? 0.0 : 1.0);
            is_identity[m] = same;
        }
        for (Index e = 0; e < n; ++e) {
            const double* __restrict block = blocks[e].data();
            double* __restrict sum = sums[slots[e]].data();
            if (is_identity[rows[e]] && is_identity[columns[e]]) {
                for (int i = 0; i < d * d; ++i) sum[i] += block[i];
                continue;
            }
            const double *left = matrices[rows[e]].data(), *right = matrices[columns[e]].data();
            double half[d][d] = {};
            for (int k = 0; k < d; ++k)
                for (int l = 0; l < d; ++l)
                    for (int j = 0; j < d; ++j) half[k][j] += block[k * d + l] * right[l * d + j];
            for (int i = 0; i < d; ++i)
                for (int j = 0; j < d; ++j) {
                    double all = 0.0;
                    for (int k = 0; k < d; ++k) all += left[k * d + i] * half[k][j];
                    sum[i * d + j] += all;
                }
        }
    });
}

}  // namespace mesh_motion
