// Loops of point reductions: errors at boundary nodes, the farthest-first order, triangles that grow a row at a time.
#pragma once

#include <utility>

#include "view.h"

namespace mesh_motion {

/// (n,) Euclidean lengths of (n, k) vectors.
Owned<double, 1> lengths(Matrix<const double> vectors);

/// error[i] += column[i] factor, in place: (n, k), (n,), (k,).
void add_multiple(Matrix<double> error, Vector<const double> column, Vector<const double> factor);

/// Takes β φ(|x − x_node|/R) off the errors; thesis (2.10) at the boundary. The first node of the largest error.
///
/// (n, 3) points, (k,) beta, (n, k) error, (n,) size, which becomes the errors' lengths.
Index subtract_function(int code, Matrix<const double> points, Index node, double inverse_radius,
                        Vector<const double> beta, Matrix<double> error, Vector<double> size);

/// The order and separation (n,) of (n, 3) points, each the farthest from all before it; given (g,) ones come first.
///
/// Ties go to the lower number. The first one's separation is infinite.
std::pair<Owned<Index, 1>, Owned<double, 1>> farthest_first(Matrix<const double> points, Vector<const Index> given);

/// x (n,) of L x = right (n,), L the leading block of a lower triangle (m, m).
Owned<double, 1> forward_substitute(Matrix<const double> lower, Vector<const double> right);

/// x (n, k) of Lᵀ x = right (n, k), L the leading block of a lower triangle (m, m).
Owned<double, 2> back_substitute(Matrix<const double> lower, Matrix<const double> right);

}  // namespace mesh_motion
