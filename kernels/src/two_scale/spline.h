// A uniform cubic B-spline on boxes, and its gradient.
//
// Boxes lie finest first; a point belongs to the first that holds it, or if none does to the last, at whose rim it is
// then taken. Coefficients stand on the grid points −1 … cells + 1 along each axis; one without cells has one layer.
#pragma once

#include "view.h"

namespace mesh_motion {

/// Fills out (n, k) at points (n, d).
///
/// origin (b, 3), inverse (b), cells (b, 3), start (b): lower corner, 1 / spacing, cells and first coefficient of each
/// box. coefficients (c, k): box by box, x slowest.
void spline_values(Matrix<const double> points, Matrix<const double> origin, Vector<const double> inverse,
                   Matrix<const Index> cells, Vector<const Index> start, Matrix<const double> coefficients,
                   Matrix<double> out);

/// Fills out (n, k, d) with derivatives.
void spline_gradients(Matrix<const double> points, Matrix<const double> origin, Vector<const double> inverse,
                      Matrix<const Index> cells, Vector<const Index> start, Matrix<const double> coefficients,
                      Cube<double> out);

/// The coefficients (8 f − f₋ − f₊) / 6 along an axis, which loses its first and last entry: out (r, m − 2 stride) of
/// values (r, m), whose neighbours are `stride` apart.
void quasi_interpolate(Matrix<const double> values, Index stride, Matrix<double> out);

}  // namespace mesh_motion
