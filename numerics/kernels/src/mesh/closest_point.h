// The closest points of segments and triangles, and those that their interpolated directions lead to.
#pragma once

#include "view.h"

namespace mesh_motion {

/// out[i] (n, 3): the point nearest to points[i] (n, 3) on its candidates, which are the facets (f, 2 or 3, 3) with the
/// numbers candidates[starts[i]:starts[i + 1]] (c,); facets[i]: its facet, of equally near ones the first candidate.
/// Both are left as they are where nothing is near: no candidate, or a place that is not finite.
void closest_points(Matrix<const double> points, Cube<const double> corners, Vector<const Index> starts,
                    Vector<const Index> candidates, Matrix<double> out, Vector<Index> facets);

/// out[i] (n, 3): the nearest point of the candidates to which points[i] comes along a normal that is interpolated
/// between a facet's corners; left as it is where there is none. It changes continuously with the point near the facets,
/// where the closest point jumps over their kinks.
///
/// `directions` (f, 2 or 3, 3) at each corner: of segments a tangent, along the segment; of triangles a normal.
/// `nearest` (n,): numbers of facets that are tried first.
void smooth_points(Matrix<const double> points, Cube<const double> corners, Cube<const double> directions,
                   Vector<const Index> nearest, Vector<const Index> starts, Vector<const Index> candidates,
                   Matrix<double> out);

/// near[i]: whether points[i] (n, 3) is within a distance of one of the facets (f, 2 or 3, 3).
void points_near_facets(Matrix<const double> points, Cube<const double> corners, double distance, Vector<bool> near);

}  // namespace mesh_motion
