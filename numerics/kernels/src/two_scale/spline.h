// A uniform cubic B-spline on boxes, and its gradient.
//
// The finest box comes first. A point belongs to the first box that contains it; if no box does, to the last box, where
// it is moved to the rim. Coefficients belong to the grid points −1 … cells + 1 along each axis; an axis without cells
// has one layer.
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

/// The transpose of spline_values: adds to out (c, k) the contributions of values (n, k) at the points.
void add_spline_coefficients(Matrix<const double> points, Matrix<const double> origin, Vector<const double> inverse,
                             Matrix<const Index> cells, Vector<const Index> start, Matrix<const double> values,
                             Matrix<double> out);

/// The coefficients (8 f − f₋ − f₊) / 6 along an axis, which loses its first and last entry: out (r, m − 2 stride) from
/// values (r, m), whose neighbours are `stride` apart.
void quasi_interpolate(Matrix<const double> values, Index stride, Matrix<double> out);

/// Blends the coefficients of a box, own (n0, n1, n2 k), with those of its parent (p0, p1, p2 k), which has twice the
/// spacing.
///
/// first (3): the parent's layer just below the box's first layer, along each axis. share0 (n0), share1 (n1), share2
/// (n2): factors along the axes, whose product is the share of each of the box's coefficients. An axis of one layer has
/// no cells.
void blend_with_parent(Cube<const double> parent, Vector<const Index> first, Vector<const double> share0,
                       Vector<const double> share1, Vector<const double> share2, Cube<double> own);

}  // namespace mesh_motion
