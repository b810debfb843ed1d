// A tree of boxes over points: sorted along the Morton curve and cut where its leading bits change.
//
// A box is the bounding box of its own points, not a cell of a grid: surfaces fill little of their cells.
#pragma once

#include <tuple>

#include "view.h"

namespace mesh_motion {

/// The boxes of points (n ≥ 1, 3) with their sorted codes (n), d bits a level; boxes of more than `leaf` distinct codes
/// are cut. Parents come before their children, those of one parent are side by side.
///
/// Returns the boxes' parent (b), points_of (b, 2), children_of (b, 2), the first box of each level and the number of
/// boxes (l + 1), and lower and upper corners (b, 3), (b, 3); pairs are a first and one past the last.
std::tuple<Owned<Index, 1>, Owned<Index, 2>, Owned<Index, 2>, Owned<Index, 1>, Owned<double, 2>, Owned<double, 2>>
build_box_tree(Vector<const Index> codes, Matrix<const double> points, int d, Index leaf);

}  // namespace mesh_motion
