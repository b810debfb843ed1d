// The facets of cells: which of them belong to one cell, and which two are the same.
#pragma once

#include <tuple>

#include "view.h"

namespace mesh_motion {

/// Facet f of cell c has the number 8 c + f.
inline constexpr Index facets_per_cell = 8;

/// Compares facets with those that have the same smallest node, a few dozen, by their nodes.
///
/// nodes (k,): of all cells, one after the other, not negative. blocks (b, 2): cells of each type, and nodes of a cell.
/// local (b, f ≤ 8, 4): local nodes of the facets, anticlockwise as seen from outside, filled up with −1.
/// Returns the numbers of the facets that one cell has, ascending; if asked, the pairs (m, 2) of those that two have,
/// ordered by their cells (of more than two the first ones); and the least number of a facet that more cells have, or
/// two on the same side of it, or −1.
std::tuple<Owned<Index, 1>, Owned<Index, 2>, Index> match_facets(Vector<const Node> nodes, Matrix<const Index> blocks,
                                                                 Cube<const Index> local, bool pairs);

}  // namespace mesh_motion
