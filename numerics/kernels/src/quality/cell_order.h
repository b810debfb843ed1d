// Cells in the lexicographic order of their nodes.
#pragma once

#include <utility>
#include <vector>

#include "view.h"

namespace mesh_motion {

/// Renumbers and sorts the cells of one type.
///
/// pieces: new numbers of the nodes that the cells (m_i, k) name, and these cells; every number is below `nodes`. The
/// type of `order` is int32 or int64. rows (m, k) ascend, equal rows in their original order; order (m,) has the
/// original place of each row, counted through the pieces. Cells are put in one bucket for each first node, and each
/// bucket is sorted by the other nodes. Returns the first row that equals the row before it, or −1.
template <class Order>
Index sort_cells(const std::vector<std::pair<Vector<const Index>, Matrix<const Node>>>& pieces, Index nodes,
                 Matrix<Node> rows, Vector<Order> order);

/// The first row of nodes (m, k) with a repeated entry, or −1.
Index first_row_with_repetition(Matrix<const Node> nodes);

}  // namespace mesh_motion
