// The closest points of segments and triangles.
#pragma once

#include "view.h"

namespace mesh_motion {

/// out[i] (n, 3): the point nearest to points[i] (n, 3) on its candidates, which are the facets (f, 2 or 3, 3) with the
/// numbers candidates[starts[i]:starts[i + 1]] (c,); facets[i]: its facet, of equally near ones the first candidate.
/// Both are left as they are where nothing is near: no candidate, or a place that is not finite.
void closest_points(Matrix<const double> points, Cube<const double> corners, Vector<const Index> starts,
                    Vector<const Index> candidates, Matrix<double> out, Vector<Index> facets);

}  // namespace mesh_motion
