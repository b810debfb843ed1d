// The linear systems of Newton's method: symmetric d × d blocks (b, d, d) in rows (row_starts (f + 1), columns (b)),
// the diagonal's block first in a row.
#pragma once

#include <tuple>

#include "view.h"

namespace mesh_motion {

/// product (f, d) = H x; returns xᵀ H x.
double block_product(Vector<const Index> row_starts, Vector<const std::int32_t> columns, Cube<const double> blocks,
                     Matrix<const double> x, Matrix<double> product);

/// For each node (f) the number of its aggregate: some `size` neighbours. Each aggregate grows next to the one before,
/// so neighbouring aggregates have near numbers.
Owned<std::int32_t, 1> node_aggregates(Vector<const Index> row_starts, Vector<const std::int32_t> columns,
                                       Index size);

/// Conjugate gradients from x (f, d) = 0, until the preconditioned residual has fallen by the tolerance or the
/// curvature is lost; returns how many iterations. The preconditioner adds the diagonal's blocks inverted, and the
/// system inverted in which every one of the aggregates (f) moves as one.
int block_conjugate_gradients(Vector<const Index> row_starts, Vector<const std::int32_t> columns,
                              Cube<const double> blocks, Vector<const std::int32_t> aggregates,
                              Matrix<const double> right, double tolerance, int most, Matrix<double> x);

/// (row_starts, columns, slots) of the r representatives: node i of the pattern belongs to targets[i] (f), order (f)
/// has the nodes by their targets, and slots (b) says where each block goes.
std::tuple<Owned<Index, 1>, Owned<std::int32_t, 1>, Owned<Index, 1>> linked_pattern(
    Vector<const Index> row_starts, Vector<const std::int32_t> columns, Vector<const Index> targets,
    Vector<const Index> order, Index n_roots);

/// sums (b', d, d) += M_rᵀ H M_c at the slot (b) of each block H (b, d, d), r and c its row and column, M (f, d, d).
void add_linked_blocks(Vector<const Index> rows, Vector<const Index> columns, Vector<const Index> slots,
                       Cube<const double> matrices, Cube<const double> blocks, Cube<double> sums);

}  // namespace mesh_motion
