// Pairs of a boundary's facets that may meet.
#pragma once

#include "view.h"

namespace mesh_motion {

/// Rows (p, 2), the lower one first, of facets that may meet with their nodes at points (n, d), in two or three dimensions.
///
/// `facets` (f, 2) or (f, 4): rows of nodes, neighbours in the list should be neighbours in space; −1 ends a triangle.
/// `moving` (f,): at least one facet of each pair moves. Pairs with a common node are left out, and those with a gap of
/// more than `margin` along an axis or along the mean normal of one of them.
Owned<Index, 2> near_facets(Matrix<const double> points, Matrix<const Node> facets, Vector<const bool> moving,
                            double margin);

}  // namespace mesh_motion
