// Sums over some centres at some points each.
#pragma once

#include "view.h"

namespace mesh_motion {

/// out (n, k): Σ_j w_j φ(|x − x_j|/R) at the points (n, 3) of each group over the group's centres.
///
/// points_of (g, 2): first point of a group and one past its last. runs (r, 2): first centre and one past the last;
/// those of group g are starts[g] … starts[g + 1] − 1, starts (g + 1). centres (3, nc), weights (k, nc).
void sum_groups(int code, Matrix<const double> points, Matrix<const Index> points_of, Vector<const Index> starts,
                Matrix<const Index> runs, Matrix<const double> centres, Matrix<const double> weights,
                double inverse_radius, Matrix<double> out);

}  // namespace mesh_motion
