// When a boundary meets itself on its way.
#pragma once

#include "view.h"

namespace mesh_motion {

/// The least s in (0, most] at which a node meets a facet, or an edge an edge, if all nodes go on from points (n, d) by s
/// times the step from `before` (n, d), in two or three dimensions; ∞ without such an s.
///
/// The volume of the simplex of both is a polynomial, so its roots are exact; one counts if the node is inside the facet.
/// Left out are pairs that are in a plane at the beginning, pairs far from any moving facet, and facets of blocks that never
/// face each other on the way. Blocks of facets are taken in the order in which their boxes meet, up to the first contact.
///
/// `facets` (f, d): segments or triangles; `starts` (b,), ascending from 0: the first facet of each block, of neighbours
/// with similar normals. `moving` (f,): whether a node of the facet moves.
double first_contact(Matrix<const double> points, Matrix<const double> before, Matrix<const Node> facets,
                     Vector<const Index> starts, Vector<const bool> moving, double most);

}  // namespace mesh_motion
