// Interpolation from the points of a uniform grid, linear or cubic (Lagrange, four points an axis).
//
// Places (n, 3) are in spacings of the grid, whose shape (3) is 1 along an absent axis; its points are numbered z
// fastest. A stencil has `width` points along an axis, 2 or 4, half of them on each side.
#pragma once

#include "view.h"

namespace mesh_motion {

/// Marks the grid points (flat) that the interpolation at these places needs.
void mark_stencils(Matrix<const double> places, Vector<const Index> shape, int width, Vector<bool> marked);

/// out (n, k): the sum of the stencil's values (g, k), in rows of the flat grid index, times the tensor product of
/// weights.
void interpolate_on_grid(Matrix<const double> places, Vector<const Index> shape, int width, Vector<const Index> rows,
                         Matrix<const double> values, Matrix<double> out);

}  // namespace mesh_motion
