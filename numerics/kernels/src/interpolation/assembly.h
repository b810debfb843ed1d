// Entries of the interpolation matrix: dense blocks, and sparse rows found through the cells of centres.
#pragma once

#include <tuple>

#include "view.h"

namespace mesh_motion {

/// out[i, j] = φ(|rows[i] − columns[:, j]|/R): (m, 3) rows, (3, n) columns, (m, n) out.
void fill_block(int code, Matrix<const double> rows, Matrix<const double> columns, double inverse_radius,
                Matrix<double> out);

/// The rows (r,) of points (n, d) with any of the (3, nc) centres near their cell, and the points of these rows (r, 3),
/// cell by cell, without the rows (u,) that the caller excludes.
///
/// The last seven arguments as in count_near.
std::pair<Owned<Index, 1>, Owned<double, 2>> rows_near(Matrix<const double> points, Vector<const Index> skipped,
                                                       Matrix<const double> centres, Vector<const double> origin,
                                                       double inverse_side, Vector<const Index> shape,
                                                       Vector<const Index> starts, Vector<const Index> keys,
                                                       Matrix<const std::int32_t> spans,
                                                       Matrix<const std::int32_t> stored);

/// (n,) numbers of (3, nc) centres closer than R to each of (n, 3) points.
///
/// The last seven arguments are the grid that finds centres near a place: a grid of all cells as in CentreGrid (origin,
/// inverse side, shape, starts), or, if there are keys, a grid that stores few of its cells as in HashedCells (origin,
/// inverse side, keys, spans, stored).
Owned<Index, 1> count_near(Matrix<const double> points, Matrix<const double> centres, double radius,
                           Vector<const double> origin, double inverse_side, Vector<const Index> shape,
                           Vector<const Index> starts, Vector<const Index> keys, Matrix<const std::int32_t> spans,
                           Matrix<const std::int32_t> stored);

/// Pointers (n + 1,) of rows, columns and entries (e,).
using SparseMatrix = std::tuple<Owned<std::int32_t, 1>, Owned<std::int32_t, 1, UnfilledVector<std::int32_t>>,
                                Owned<double, 1, UnfilledVector<double>>>;

/// φ between the points and the centres closer than R; the entries of each point in the order of the centres.
///
/// numbers (nc,) are the column numbers of the centres; the other arguments as in count_near.
SparseMatrix near_rows(int code, Matrix<const double> points, Matrix<const double> centres, Vector<const Index> numbers,
                       double radius, Vector<const double> origin, double inverse_side, Vector<const Index> shape,
                       Vector<const Index> starts, Vector<const Index> keys, Matrix<const std::int32_t> spans,
                       Matrix<const std::int32_t> stored);

}  // namespace mesh_motion
