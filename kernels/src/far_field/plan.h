// Which box of points takes which box of centres through a polynomial, and of how many points.
#pragma once

#include <tuple>

#include "view.h"

namespace mesh_motion {

/// Walks down the boxes of points, each with a list of the boxes of centres that are still to be settled for it.
///
/// One that cannot reach a box of points is dropped; one that a polynomial in that box can stand for, within the bound
/// asked for a unit of weight and at less cost than its points, is settled there; the others are left to the box's
/// children, cut where they are larger than it. What is left at a leaf is summed directly.
///
/// low, high (b, 3), parent (b), points_of and children_of (b, 2): the boxes of points, in support radii. other_low,
/// other_high (o, 3), centres_of and parts_of (o, 2), weight (o): those of centres, and the sum of their weights.
/// table (orders, 1 + distances): bounds of derivatives by order; column 0 is for any distance, column i + 1 from
/// distances[i] on. reach, across: where the function ends, and the highest order whose bound holds across. lebesgue
/// (orders): of each order. tolerance: error allowed for a unit of weight. d, highest, share: the space's dimension,
/// the highest order, and the share of a box's points that a polynomial may have.
///
/// Returns far and near entries (e, 4) of box, order, first and last centre, and the bound (b) of the error at a point
/// of each box of the polynomials of the box and of those above it.
std::tuple<Owned<Index, 2>, Owned<Index, 2>, Owned<double, 1>> plan_far_field(
    Matrix<const double> low, Matrix<const double> high, Vector<const Index> parent, Matrix<const Index> points_of,
    Matrix<const Index> children_of, Matrix<const double> other_low, Matrix<const double> other_high,
    Matrix<const Index> centres_of, Matrix<const Index> parts_of, Vector<const double> weight,
    Matrix<const double> table, Vector<const double> distances, double reach, int across,
    Vector<const double> lebesgue, double tolerance, int d, int highest, double share);

}  // namespace mesh_motion
