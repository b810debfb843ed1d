// Cells in the lexicographic order of their nodes.
#pragma once

#include <utility>
#include <vector>

#include "view.h"

namespace mesh_motion {

/// Cells of one type, renumbered and sorted.
///
/// pieces: new numbers of the nodes that the cells (m_i, k) name, and these cells; every number below `nodes`. Order is
/// int32 or int64. rows (m, k) are ascending, equal ones in the order they came; order (m,) is where
/// each came from, counted through the pieces. Cells go to one bucket for each first node, each sorted by the others.
/// Returns the first row that equals the one before it, or −1.
template <class Order>
Index sort_cells(const std::vector<std::pair<Vector<const Index>, Matrix<const Node>>>& pieces, Index nodes,
                 Matrix<Node> rows, Vector<Order> order);

/// The first row of nodes (m, k) with a repeated entry, or −1.
Index first_row_with_repetition(Matrix<const Node> nodes);

}  // namespace mesh_motion
