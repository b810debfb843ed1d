// The facets of cells: facets that belong to only one cell, and pairs of equal facets.
#pragma once

#include <tuple>

#include "view.h"

namespace mesh_motion {

/// Facet f of cell c has the number 8 c + f.
inline constexpr Index facets_per_cell = 8;

/// Compares the nodes of all facets that have the same smallest node, a few dozen.
///
/// nodes (k,): the nodes of all cells, one cell after the other, not negative. blocks (b, 2): cells of each type, and
/// nodes of a cell. local (b, f ≤ 8, 4): local nodes of the facets, anticlockwise as seen from outside, filled up with
/// −1. Returns the numbers of the facets that only one cell has, ascending; on request the pairs (m, 2) of facets that
/// two cells share, ordered by their cells (of more than two equal facets, the first two); and the smallest number of a
/// facet that more than two cells share, or two on the same side, or −1.
std::tuple<Owned<Index, 1>, Owned<Index, 2>, Index> match_facets(Vector<const Node> nodes, Matrix<const Index> blocks,
                                                                 Cube<const Index> local, bool pairs);

}  // namespace mesh_motion
