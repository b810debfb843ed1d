// Points sorted by the cells of a uniform grid: what finds the centres near a place.
//
// Cells are numbered x fastest. The sums walk them (CentreGrid).
#pragma once

#include "view.h"

namespace mesh_motion {

/// Centres sorted by cells, in their own order within one, and the grid that finds them.
struct CentreLayout {
    Owned<Index, 1> order;         // (n,) row j of the sorted arrays is centre order[j]
    Owned<double, 2> coordinates;  // (3, n)
    Owned<double, 1> origin;       // (3,) lower corner of all centres
    double inverse_side;           // 0 for a single cell
    double extent;                 // of all centres, along the axis where it is largest
    Owned<Index, 1> shape;         // (3,) cells along each axis
    Owned<Index, 1> starts;        // (cells + 1,) first sorted centre of each cell
    double fraction;               // mean share of the centres in the cells around a centre: what a sum visits
};

/// Lays out points (n, 3) by cells as wide as what a centre reaches, where that saves enough; else in a single cell, as
/// for a reach of 0, which stands for everywhere.
CentreLayout lay_out_centres(Matrix<const double> points, double reach);

/// Lays out a part of the centres on the grid of all: all centres of the cells that it has any of. Its `fraction` is 1.
CentreLayout lay_out_on_grid(Matrix<const double> points, Vector<const double> origin, double inverse_side,
                             double extent, Vector<const Index> shape);

/// Marks in reached, flat with a cell more on each side and false at first, cells with a point and those next to them.
void mark_neighbours(Vector<const Index> starts, Vector<const Index> shape, Vector<bool> reached);

/// out[i]: whether the cell of points[i] (n, d) is marked by mark_neighbours.
void mark_reached(Matrix<const double> points, Vector<const double> origin, double inverse_side,
                  Vector<const Index> shape, Vector<const bool> reached, Vector<bool> out);

}  // namespace mesh_motion
