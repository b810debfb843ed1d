// Nodes of a boundary that may meet one of its facets on their way.
#pragma once

#include "view.h"

namespace mesh_motion {

/// Rows (m, d + 1): a facet and a node that may meet it while all nodes go straight from points (n, d) to `there` (n, d),
/// in two or three dimensions. In the order of a row they are a simplex of positive volume at the beginning. Left out are
/// pairs whose boxes do not meet on the way, pairs far from any moving facet, and nodes in the facet's plane at the beginning.
///
/// `facets` (f, d): segments or triangles, neighbours next to each other: they are taken in blocks. Blocks whose normals all
/// have a cosine above 0.3 are left out too. `moving` (f,): whether a node of the facet moves.
Owned<Node, 2> approaching_nodes(Matrix<const double> points, Matrix<const double> there, Matrix<const Node> facets,
                                 Vector<const bool> moving);

}  // namespace mesh_motion
