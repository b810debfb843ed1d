// The linear systems of Newton's method: symmetric d × d blocks (b, d, d) in rows (row_starts (f + 1), columns (b)),
// with the diagonal block first in each row.
#pragma once

#include <tuple>

#include "view.h"

namespace mesh_motion {

/// product (f, d) = H x; returns xᵀ H x.
double block_product(Vector<const Index> row_starts, Vector<const std::int32_t> columns, Cube<const double> blocks,
                     Matrix<const double> x, Matrix<double> product);

/// For each node (f) the number of its aggregate of about `size` neighbours. Each aggregate grows next to the one
/// before, so neighbouring aggregates have similar numbers.
Owned<std::int32_t, 1> node_aggregates(Vector<const Index> row_starts, Vector<const std::int32_t> columns,
                                       Index size);

/// Conjugate gradients from x (f, d) = 0, until the preconditioned residual has fallen by the tolerance or negative
/// curvature is found; returns the number of iterations. The preconditioner is the sum of two inverses: of the diagonal
/// blocks, and of the system in which each of the aggregates (f) moves as one.
int block_conjugate_gradients(Vector<const Index> row_starts, Vector<const std::int32_t> columns,
                              Cube<const double> blocks, Vector<const std::int32_t> aggregates,
                              Matrix<const double> right, double tolerance, int most, Matrix<double> x);

/// (row_starts, columns, slots) of the r representatives: node i of the pattern belongs to targets[i] (f); order (f)
/// lists the nodes by their targets; slots (b) has the place to which each block is added.
std::tuple<Owned<Index, 1>, Owned<std::int32_t, 1>, Owned<Index, 1>> linked_pattern(
    Vector<const Index> row_starts, Vector<const std::int32_t> columns, Vector<const Index> targets,
    Vector<const Index> order, Index n_roots);

/// sums (b', d, d) += M_rᵀ H M_c at the slot (b) of each block H (b, d, d), with its row r and column c, and M
/// (f, d, d).
void add_linked_blocks(Vector<const Index> rows, Vector<const Index> columns, Vector<const Index> slots,
                       Cube<const double> matrices, Cube<const double> blocks, Cube<double> sums);

}  // namespace mesh_motion
