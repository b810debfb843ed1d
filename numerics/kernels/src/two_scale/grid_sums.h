// Sums over centres at the points of a uniform grid, block by block: near centres directly, far ones interpolated.
#pragma once

#include "view.h"

namespace mesh_motion {

/// out (nx, ny, nz k): Σ_j w_j φ(|x − x_j|/R) at the points low + spacing (i, j, m), x slowest.
///
/// centres (3, nc), weights (k, nc), low (3). A centre that is more than distances[p] (9) half widths from the middle
/// of a block of the grid is summed through a polynomial of p = 4 … 8 points an axis, with the smallest such p. φ
/// vanishes beyond `reach` (which may be infinite) from a centre: no polynomial crosses that distance.
void sum_on_grid(int code, Matrix<const double> centres, Matrix<const double> weights, double inverse_radius,
                 double reach, Vector<const double> low, double spacing, Vector<const double> distances,
                 Cube<double> out);

/// out (k, nc) = Σ values φ over the points of the grid, values (nx, ny, nz k): the transpose of sum_on_grid.
void sum_from_grid(int code, Matrix<const double> centres, Cube<const double> values, double inverse_radius,
                   double reach, Vector<const double> low, double spacing, Vector<const double> distances,
                   Matrix<double> out);

}  // namespace mesh_motion
