// Loops over the positions of all nodes.
#pragma once

#include "view.h"

namespace mesh_motion {

/// (2, d) smallest and largest coordinates of finite points (n, d), n ≥ 1.
Owned<double, 2> corners_of(Matrix<const double> points);

/// out[k] += values[k].
void add_values(Vector<const double> values, Vector<double> out);

/// moved[k] becomes base[k] + (moved[k] − base[k]), rounded; returns the number of changed entries.
Index round_differences(Vector<double> moved, Vector<const double> base);

/// found[j] = moved[rows[j]] − base[rows[j]].
void take_differences(Matrix<const double> moved, Matrix<const double> base, Vector<const Index> rows,
                      Matrix<double> found);

}  // namespace mesh_motion
