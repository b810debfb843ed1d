// Points sorted by the cells of a uniform grid: what finds the centres near a place.
//
// Cells are numbered x fastest. centres.py decides on the grid and holds the arrays; the sums walk them.
#pragma once

#include "view.h"

namespace mesh_motion {

/// Fills order (n) so that points[order] (n, 3) are sorted by cells, in their own order within one, and starts
/// (cells + 1) with the first point of each cell.
void sort_by_cells(Matrix<const double> points, Vector<const double> origin, double inverse_side,
                   Vector<const Index> shape, Vector<Index> order, Vector<Index> starts);

/// Pairs of points of which one is in the cell of the other or next to it.
Index count_neighbours(Vector<const Index> starts, Vector<const Index> shape);

/// Marks in reached, flat with a cell more on each side and false at first, cells with a point and those next to them.
void mark_neighbours(Vector<const Index> starts, Vector<const Index> shape, Vector<bool> reached);

/// out[i]: whether the cell of points[i] (n, d) is marked by mark_neighbours.
void mark_reached(Matrix<const double> points, Vector<const double> origin, double inverse_side,
                  Vector<const Index> shape, Vector<const bool> reached, Vector<bool> out);

}  // namespace mesh_motion
