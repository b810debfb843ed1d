// Points sorted by the cells of a uniform grid, to find the centres near a place.
//
// Cells are numbered x fastest. The sums iterate over them (CentreGrid).
#pragma once

#include "view.h"

namespace mesh_motion {

/// Centres sorted by cells, in their original order within a cell, and the grid that finds them.
struct CentreLayout {
    Owned<Index, 1> order;         // (n,) row j of the sorted arrays is centre order[j]
    Owned<double, 2> coordinates;  // (3, n)
    Owned<double, 1> origin;       // (3,) lower corner of all centres
    double inverse_side;           // 0 for a single cell
    double extent;                 // extent of all centres, along their longest axis
    Owned<Index, 1> shape;         // (3,) number of cells along each axis
    Owned<Index, 1> starts;        // (cells + 1,) first sorted centre of each cell
    double fraction;               // mean share of the centres in the cells around a centre, which a sum visits
};

/// Lays out points (n, 3) in cells as wide as the reach of a centre, if that saves enough; else in a single cell, also
/// for a reach of 0, which means an unlimited reach.
CentreLayout lay_out_centres(Matrix<const double> points, double reach);

/// Lays out a part of the centres on the grid of all centres: the part has all centres of each of its cells. Its
/// `fraction` is 1.
CentreLayout lay_out_on_grid(Matrix<const double> points, Vector<const double> origin, double inverse_side,
                             double extent, Vector<const Index> shape);

/// Marks in `reached` the cells with a point and their neighbours. `reached` is flat, has one more cell on each side,
/// and is false at first.
void mark_neighbours(Vector<const Index> starts, Vector<const Index> shape, Vector<bool> reached);

/// out[i]: whether the cell of points[i] (n, d) was marked by mark_neighbours.
void mark_reached(Matrix<const double> points, Vector<const double> origin, double inverse_side,
                  Vector<const Index> shape, Vector<const bool> reached, Vector<bool> out);

}  // namespace mesh_motion
