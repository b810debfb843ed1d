// How far nodes can continue their step before a cell inverts.
#pragma once

#include <utility>
#include <vector>

#include "view.h"

namespace mesh_motion {

/// The least s in (0, horizon] at which a corner determinant of a cell is 0 if all nodes, at points (n, d) after a step
/// from `before` (n, d), make s further such steps; for the `count` cells with the smallest ones, ascending, and the numbers of these cells through all blocks (of equal
/// values the lower numbers first). 0 for a cell that is invalid at points, ∞ for a cell without such an s.
///
/// The determinant of edges E + s V is a polynomial of degree d in s, so its first root is found exactly. Roots are
/// sought only where one is possible: a polynomial whose Bernstein coefficients on (0, limit) are all positive has no
/// root there.
///
/// Whether one of the first cells is in a group of adjacent cells is estimated from samples: the first cell of the group
/// and of the next one, and the cells `near` (ascending), where the step may be different in each cell. No cell inverts
/// before 1 / (its fastest shortening in a step), which is alike in adjacent cells whatever their shapes, and does not see
/// rotations. All cells of a group are looked at if this number of steps is among the first for one of its samples, up to
/// a factor: that by which a group was found to be earlier, and a fifth more. If it is 2, or if the step is rough, all
/// cells of the mesh are looked at.
std::pair<Owned<double, 1>, Owned<Index, 1>> first_inversions(Matrix<const double> points, Matrix<const double> before,
                                                              const std::vector<Matrix<const Node>>& blocks,
                                                              Vector<const Index> near, double horizon, Index count);

}  // namespace mesh_motion
