// The displacements that lead from given coordinates to a motion's, and the coordinates that they lead to.
#pragma once

#include "view.h"

namespace mesh_motion {

/// moved[k] becomes base[k] + (moved[k] − base[k]), rounded; how many entries that changed.
Index round_differences(Vector<double> moved, Vector<const double> base);

/// found[j] = moved[rows[j]] − base[rows[j]].
void take_differences(Matrix<const double> moved, Matrix<const double> base, Vector<const Index> rows,
                      Matrix<double> found);

}  // namespace mesh_motion
