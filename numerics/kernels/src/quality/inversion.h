// How far nodes can continue their step before a cell inverts.
#pragma once

#include <utility>
#include <vector>

#include "view.h"

namespace mesh_motion {

/// The least s in (0, horizon] at which a corner determinant of a cell is 0 with the nodes at points + s step (n, d), for
/// the `count` cells with the smallest ones, ascending, and the numbers of these cells through all blocks (of equal
/// values the lower numbers first). 0 for a cell that is invalid at points, ∞ for a cell without such an s.
///
/// The determinant of edges E + s V is a polynomial of degree d in s, so its first root is found exactly. Roots are
/// sought only where one is possible: a sample of the cells gives an upper limit of the smallest ones, and a polynomial
/// whose Bernstein coefficients on (0, limit) are all positive has no root there.
std::pair<Owned<double, 1>, Owned<Index, 1>> first_inversions(Matrix<const double> points, Matrix<const double> step,
                                                              const std::vector<Matrix<const Node>>& blocks,
                                                              double horizon, Index count);

}  // namespace mesh_motion
