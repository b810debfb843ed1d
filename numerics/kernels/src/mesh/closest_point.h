// Closest points on segments and triangles, and points reached along their interpolated directions.
#pragma once

#include "view.h"

namespace mesh_motion {

/// out[i] (n, 3): the point nearest to points[i] (n, 3) on its candidates, which are the facets (f, 2 or 3, 3) with the
/// numbers candidates[starts[i]:starts[i + 1]] (c,). facets[i]: the facet of that point; of equally near facets, the
/// first candidate. Both stay unchanged if there is no candidate or a position is not finite.
void closest_points(Matrix<const double> points, Cube<const double> corners, Vector<const Index> starts,
                    Vector<const Index> candidates, Matrix<double> out, Vector<Index> facets);

/// out[i] (n, 3): the nearest point of the candidates from which points[i] lies along a normal that is interpolated
/// between a facet's corners; unchanged if there is none. Near the facets it changes continuously with the point, while
/// the closest point jumps over their kinks.
///
/// `directions` (f, 2 or 3, 3) at each corner: for segments a tangent along the segment; for triangles a normal.
/// `nearest` (n,): numbers of the facets that are tried first.
void smooth_points(Matrix<const double> points, Cube<const double> corners, Cube<const double> directions,
                   Vector<const Index> nearest, Vector<const Index> starts, Vector<const Index> candidates,
                   Matrix<double> out);

/// near[i]: whether points[i] (n, 3) is within a distance of one of the facets (f, 2 or 3, 3).
void points_near_facets(Matrix<const double> points, Cube<const double> corners, double distance, Vector<bool> near);

}  // namespace mesh_motion
