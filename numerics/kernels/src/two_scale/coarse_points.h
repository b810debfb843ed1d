// The choice of the control points that carry the motion into the volume.
#pragma once

#include "view.h"

namespace mesh_motion {

/// Clears taken (n) for the second point of every pair (p, 2) whose first point is taken; pairs are in the order of the
/// first.
void drop_followers(Matrix<const Index> pairs, Vector<bool> taken);

/// Fills chosen: each next of the points (n, 3) has the largest weight (n) × squared distance from those before, of
/// equal ones the lower number; the first is point 0.
///
/// Returns the number of chosen points when all others are closer than the squared distance `least` to one of them.
Index choose_farthest(Matrix<const double> points, Vector<const double> weights, double least, Vector<Index> chosen);

}  // namespace mesh_motion
