// How far nodes can continue their step before a cell inverts.
#pragma once

#include "view.h"

namespace mesh_motion {

/// steps[c] (m,): the least s in (0, horizon] at which a corner determinant of cell c is 0 with the nodes at
/// points + s step (n, d), or ∞ if there is none; 0 for a cell that is invalid at points.
///
/// nodes (m, k) of cells of one type; corners (q, d + 1): local numbers of each corner's node and its neighbours. The
/// determinant of edges E + s V is a polynomial of degree d in s, so its first root is found exactly.
void steps_to_inversion(Matrix<const double> points, Matrix<const double> step, Matrix<const Node> nodes,
                        Matrix<const Index> corners, double horizon, Vector<double> steps);

}  // namespace mesh_motion
