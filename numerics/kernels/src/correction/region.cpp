#include "correction/region.h"

#include <algorithm>

#include "parallel.h"
#include "quality/cell_quality.h"

namespace mesh_motion {
namespace {

constexpr Index rows_of_gather = 1 << 11, rows_of_assembly = 1 << 6;

constexpr Index ahead = 8;  // entries: their blocks are spread over memory, so they are prefetched

void prefetch(Vector<const float> values) {
    for (Index k = 0; k < values.size(); k += 16) __builtin_prefetch(&values[k]);
}

/// Makes starts and entries by counting sort.
template <class Node>
std::pair<std::vector<Index>, std::vector<std::int32_t>> places(Matrix<const Node> cells, Index n_free) {
    std::vector<Index> starts(n_free + 1);
    for (Node node : cells)
        if (node < n_free) ++starts[node + 1];
    for (Index i = 0; i < n_free; ++i) starts[i + 1] += starts[i];
    std::vector<std::int32_t> entries(starts[n_free]);
    std::vector<Index> next(starts.begin(), starts.end() - 1);
    for (Index at = 0; at < cells.size(); ++at) {
        const Node node = cells.data()[at];
        if (node < n_free) entries[next[node]++] = static_cast<std::int32_t>(at);
    }
    return {std::move(starts), std::move(entries)};
}

template <class Node>
void check_nodes(Matrix<const Node> cells, Index n_free, Index n_nodes) {
    require(0 <= n_free && n_free <= n_nodes, "n_free: expected 0 to as many as nodes");
    require_below(cells, n_nodes, "cells: expected numbers of nodes");
}

void check_lists(Vector<const Index> starts, Vector<const std::int32_t> entries, Index n) {
    require_starts(starts, entries.size(), "starts: expected to ascend up to the entries");
    require_below(entries, n, "entries: expected numbers of nodes of cells");
}

/// The block to which a pair's blocks are added, or null.
double* block_of(Cube<double> hessian, std::int32_t slot) {
    require(slot < hessian.shape(0), "slots: expected numbers of blocks");
    return slot < 0 ? nullptr : &hessian(slot, 0, 0);
}

/// |det P|^(2/d).
template <int d>
double inverse_square_size(const double (*p)[d]) {
    if constexpr (d == 1) {
        return p[0][0] * p[0][0];
    } else if constexpr (d == 2) {
        return std::abs(p[0][0] * p[1][1] - p[0][1] * p[1][0]);
    } else {
        double det = 0.0;
        for (int k = 0; k < 3; ++k)
            det += p[0][k] * (p[1][(k + 1) % 3] * p[2][(k + 2) % 3] - p[1][(k + 2) % 3] * p[2][(k + 1) % 3]);
        const double size = std::abs(det);
        return size * (size > 1e-200 ? inverse_cube_root(size) : 0x1p100 * inverse_cube_root(0x1p300 * size));
    }
}

/// row (d + 1, d²): the blocks that couple one node of a corner with each of its nodes, from the blocks (d, d²) that
/// couple the node's edge with each edge. The blocks of node 0 are minus the sum over the edges (d, d, d²).
template <int d, class T>
void couplings(Vector<const T> block, bool of_edge, double* __restrict row) {
    constexpr int size = d * d, width = size * d;
    if (of_edge) {
        for (int q = 0; q < width; ++q) row[size + q] = block[q];
    } else {
        for (int q = 0; q < width; ++q) {
            double sum = 0.0;
            for (int j = 0; j < d; ++j) sum += block[j * width + q];
            row[size + q] = -sum;
        }
    }
    for (int q = 0; q < size; ++q) {
        double sum = 0.0;
        for (int b = 1; b <= d; ++b) sum += row[b * size + q];
        row[q] = -sum;
    }
}

}  // namespace

Owned<std::uint8_t, 1> touched_cells(Matrix<const Node> cells, Vector<const bool> marked) {
    check_nodes(cells, 0, marked.size());
    std::vector<std::uint8_t> found(cells.shape(0));
    for (Index c = 0; c < cells.shape(0); ++c)
        for (Node node : cells[c]) found[c] |= marked[node];
    return owned(std::move(found));
}

std::tuple<Owned<Index, 1>, Owned<std::int32_t, 1>, Owned<std::int32_t, 2>, Owned<Index, 1>, Owned<std::int32_t, 1>>
node_adjacency(Matrix<const std::int32_t> corners, Index n_free, Index n_nodes, Matrix<const Index> diagonals) {
    check_nodes(corners, n_free, n_nodes);
    check_nodes(diagonals, n_free, n_nodes);
    require(diagonals.shape(1) == 2, "diagonals: expected shape (h, 2)");
    const Index k = corners.shape(1);
    auto [starts, entries] = places(corners, n_free);
    const auto [ends, others] = places(diagonals, n_free);
    std::vector<std::int32_t> slots(entries.size() * k, -1), columns;
    std::vector<Index> row_starts(n_free + 1), where(n_nodes, -1);
    for (Index i = 0; i < n_free; ++i) {
        const auto slot = [&](Index j) {  // the slot of column j in row i; added to the row if missing
            if (where[j] < row_starts[i]) {
                where[j] = static_cast<Index>(columns.size());
                columns.push_back(static_cast<std::int32_t>(j));
            }
            return static_cast<std::int32_t>(where[j]);
        };
        slot(i);
        for (Index e = starts[i]; e < starts[i + 1]; ++e)
            for (Index b = 0; b < k; ++b) {
                const Index j = corners(entries[e] / k, b);
                if (j < n_free) slots[e * k + b] = slot(j);
            }
        for (Index e = ends[i]; e < ends[i + 1]; ++e) {
            const Index j = diagonals(others[e] / 2, 1 - others[e] % 2);
            if (j < n_free) slot(j);
        }
        row_starts[i + 1] = static_cast<Index>(columns.size());
    }
    const auto n_entries = static_cast<Index>(entries.size());
    return {owned(std::move(starts)), owned(std::move(entries)), {std::move(slots), {n_entries, k}},
            owned(std::move(row_starts)), owned(std::move(columns))};
}

std::tuple<Owned<Index, 1>, Owned<std::int32_t, 1>, Owned<std::int32_t, 2>> cell_adjacency(
    Matrix<const std::int32_t> cells, Index n_free, Index n_nodes, Vector<const Index> row_starts,
    Vector<const std::int32_t> columns) {
    check_nodes(cells, n_free, n_nodes);
    require(row_starts.size() == n_free + 1, "row_starts: expected (f + 1)");
    require_starts(row_starts, columns.size(), "row_starts: expected to ascend up to the columns");
    require_below(columns, n_nodes, "columns: expected numbers of nodes");
    const Index k = cells.shape(1);
    auto [starts, entries] = places(cells, n_free);
    std::vector<std::int32_t> slots(entries.size() * k, -1), where(n_nodes, -1);
    for (Index i = 0; i < n_free; ++i) {
        for (Index e = row_starts[i]; e < row_starts[i + 1]; ++e) where[columns[e]] = static_cast<std::int32_t>(e);
        for (Index e = starts[i]; e < starts[i + 1]; ++e)
            for (Index b = 0; b < k; ++b) {
                const Index j = cells(entries[e] / k, b);
                if (j < n_free) slots[e * k + b] = where[j];
            }
    }
    const auto n_entries = static_cast<Index>(entries.size());
    return {owned(std::move(starts)), owned(std::move(entries)), {std::move(slots), {n_entries, k}}};
}

void gather_shares(Vector<const Index> starts, Vector<const std::int32_t> entries, Cube<const double> shares,
                   Matrix<double> sums) {
    check_lists(starts, entries, shares.shape(0) * shares.shape(1));
    require(sums.shape() == std::array{starts.size() - 1, shares.shape(2)}, "sums: expected shape (f, d)");
    with_dimension(sums.shape(1), [&](auto dimension) {
        constexpr int d = dimension;
        for_ranges(sums.shape(0), rows_of_gather, [&](Index first, Index last) {
            for (Index i = first; i < last; ++i) {
                std::array<double, d> sum{};
                for (Index e = starts[i]; e < starts[i + 1]; ++e)
                    for (int k = 0; k < d; ++k) sum[k] += shares.data()[Index{entries[e]} * d + k];
                for (int k = 0; k < d; ++k) sums(i, k) = sum[k];
            }
        });
    });
}

void assemble_corners(Vector<const Index> starts, Vector<const std::int32_t> entries, Matrix<const std::int32_t> slots,
                      Vector<const Index> row_starts, Cube<const float> blocks, Vector<const double> weights,
                      double least_weight, Cube<double> hessian) {
    check_lists(starts, entries, weights.size() * (hessian.shape(1) + 1));
    const Index size = hessian.shape(1) * hessian.shape(1);
    require(slots.shape() == std::array{entries.size(), hessian.shape(1) + 1}, "slots: expected shape (e, d + 1)");
    require(blocks.shape() == std::array{weights.size(), size, size}, "blocks: expected shape (c, d², d²)");
    require(row_starts.size() == starts.size() && hessian.shape(2) == hessian.shape(1),
            "row_starts, hessian: expected shapes (f + 1) and (b, d, d)");
    require_starts(row_starts, hessian.shape(0), "row_starts: expected to ascend up to the blocks");
    with_dimension(hessian.shape(1), [&](auto dimension) {
        constexpr int d = dimension;
        // the argument of couplings() for an entry: the whole block of a corner for its node 0, or the rows of an edge
        const auto block = [&](Index entry) {
            const Index c = entry / (d + 1), a = entry % (d + 1), width = d * d * d;
            return Vector<const float>(&blocks(c, 0, 0) + std::max<Index>(a - 1, 0) * width, {a ? width : d * width});
        };
        for_ranges(starts.size() - 1, rows_of_assembly, [&](Index first, Index last) {
            for (Index i = first; i < last; ++i) {
                if (std::none_of(&entries[starts[i]], &entries[starts[i]] + (starts[i + 1] - starts[i]),
                                 [&](auto entry) { return weights[entry / (d + 1)] >= least_weight; }))
                    continue;
                const Cube<double> fresh = hessian.rows(row_starts[i], row_starts[i + 1]);
                std::fill(fresh.begin(), fresh.end(), 0.0);
                for (Index e = starts[i]; e < starts[i + 1]; ++e) {
                    if (e + ahead < entries.size()) prefetch(block(entries[e + ahead]));
                    double row[(d + 1) * d * d];
                    couplings<d>(block(entries[e]), entries[e] % (d + 1) > 0, row);
                    for (int b = 0; b <= d; ++b) {
                        double* out = block_of(hessian, slots(e, b));
                        if (!out) continue;
                        for (int q = 0; q < d * d; ++q) out[q] += row[b * d * d + q];
                    }
                }
            }
        });
    });
}

void add_corners(Vector<const Index> starts, Vector<const std::int32_t> entries, Matrix<const std::int32_t> slots,
                 Vector<const std::int32_t> rows, Cube<const double> blocks, Cube<double> hessian) {
    const Index size = hessian.shape(1) * hessian.shape(1);
    check_lists(starts, entries, rows.size() * (hessian.shape(1) + 1));
    require(slots.shape() == std::array{entries.size(), hessian.shape(1) + 1}, "slots: expected shape (e, d + 1)");
    require(blocks.shape(1) == size && blocks.shape(2) == size, "blocks: expected shape (k, d², d²)");
    require(hessian.shape(2) == hessian.shape(1), "hessian: expected shape (b, d, d)");
    for (std::int32_t row : rows) require(row < blocks.shape(0), "rows: expected numbers of blocks");
    with_dimension(hessian.shape(1), [&](auto dimension) {
        constexpr int d = dimension;
        for_ranges(starts.size() - 1, rows_of_assembly, [&](Index first, Index last) {
            for (Index e = starts[first]; e < starts[last]; ++e) {
                const Index c = rows[entries[e] / (d + 1)], a = entries[e] % (d + 1), width = d * d * d;
                if (c < 0) continue;
                const double* from = &blocks(c, 0, 0) + std::max<Index>(a - 1, 0) * width;
                double row[(d + 1) * d * d];
                couplings<d>(Vector<const double>(from, {a ? width : d * width}), a > 0, row);
                for (int b = 0; b <= d; ++b) {
                    double* out = block_of(hessian, slots(e, b));
                    for (int q = 0; out && q < d * d; ++q) out[q] += row[b * d * d + q];
                }
            }
        });
    });
}

void add_penalty(Vector<const Index> starts, Vector<const std::int32_t> entries, Matrix<const std::int32_t> slots,
                 Cube<const double> ideals, Vector<const double> weights, Vector<double> stiffness,
                 Vector<double> mass) {
    const Index axes = ideals.shape(1);
    check_lists(starts, entries, weights.size() * (axes + 1));
    require(slots.shape() == std::array{entries.size(), axes + 1}, "slots: expected shape (e, d + 1)");
    require(ideals.shape() == std::array{weights.size(), axes, axes}, "ideals: expected shape (c, d, d)");
    require(mass.size() == starts.size() - 1, "mass: expected one number a free node");
    with_dimension(axes, [&](auto dimension) {
        constexpr int d = dimension;
        for_ranges(mass.size(), rows_of_assembly, [&](Index first, Index last) {
            for (Index i = first; i < last; ++i)
                for (Index e = starts[i]; e < starts[i + 1]; ++e) {
                    const Index c = entries[e] / (d + 1), a = entries[e] % (d + 1);
                    double gradients[d + 1][d]{};
                    for (int k = 0; k < d; ++k)
                        for (int q = 0; q < d; ++q) {
                            gradients[k + 1][q] = ideals(c, k, q);
                            gradients[0][q] -= ideals(c, k, q);
                        }
                    for (int b = 0; b <= d; ++b) {
                        const std::int32_t slot = slots(e, b);
                        require(slot < stiffness.size(), "slots: expected numbers of blocks");
                        double product = 0.0;
                        for (int q = 0; q < d; ++q) product += gradients[a][q] * gradients[b][q];
                        if (slot >= 0) stiffness[slot] += weights[c] * product;
                    }
                    mass[i] += weights[c] * inverse_square_size<d>(gradients + 1);
                }
        });
    });
}

void add_cells(Vector<const Index> starts, Vector<const std::int32_t> entries, Matrix<const std::int32_t> slots,
               Cube<const float> blocks, Cube<double> hessian) {
    const Index k = slots.shape(1);
    check_lists(starts, entries, blocks.shape(0) * k);
    require(slots.shape(0) == entries.size(), "slots: expected shape (e, k)");
    require(hessian.shape(2) == hessian.shape(1), "hessian: expected shape (b, d, d)");
    require(blocks.shape(1) == k * k && blocks.shape(2) == hessian.shape(1) * hessian.shape(1),
            "blocks: expected shape (m, k², d²)");
    with_dimension(hessian.shape(1), [&](auto dimension) {
        constexpr int d = dimension;
        const auto row = [&](Index entry) {
            return Vector<const float>(&blocks(entry / k, entry % k * k, 0), {k * d * d});
        };
        for_ranges(starts.size() - 1, rows_of_assembly, [&](Index first, Index last) {
            for (Index e = starts[first]; e < starts[last]; ++e) {
                const Vector<const float> from = row(entries[e]);
                if (e + ahead < entries.size()) prefetch(row(entries[e + ahead]));
                for (Index b = 0; b < k; ++b) {
                    double* out = block_of(hessian, slots(e, b));
                    if (!out) continue;
                    for (int q = 0; q < d * d; ++q) out[q] += from[b * d * d + q];
                }
            }
        });
    });
}

}  // namespace mesh_motion
