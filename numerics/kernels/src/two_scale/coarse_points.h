// Which control points carry the motion into the volume.
#pragma once

#include "view.h"

namespace mesh_motion {

/// Clears taken (n) of the second of every pair (p, 2) of which the first is taken; pairs in order of the first.
void drop_followers(Matrix<const Index> pairs, Vector<bool> taken);

/// Fills chosen: each next of the points (n, 3) has the largest weight (n) × squared distance from those before, of
/// equal ones the lower number; the first is point 0.
///
/// Returns how many there are until all others are at less than the squared distance `least` from one of them.
Index choose_farthest(Matrix<const double> points, Vector<const double> weights, double least, Vector<Index> chosen);

}  // namespace mesh_motion
