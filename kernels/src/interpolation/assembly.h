// Entries of the interpolation matrix: dense blocks, and sparse rows found through the cells of centres.
#pragma once

#include "view.h"

namespace mesh_motion {

/// out[i, j] = φ(|rows[i] − columns[:, j]|/R): (m, 3) rows, (3, n) columns, (m, n) out.
void fill_block(int code, Matrix<const double> rows, Matrix<const double> columns, double inverse_radius,
                Matrix<double> out);

/// Rows (r,) of points (n, d) near whose cell there are (3, nc) centres, and the points there (r, 3), cell by cell; but
/// for rows that are unasked for (u,).
///
/// The last seven arguments as of count_near.
std::pair<Owned<Index, 1>, Owned<double, 2>> rows_near(Matrix<const double> points, Vector<const Index> unasked,
                                                       Matrix<const double> centres, Vector<const double> origin,
                                                       double inverse_side, Vector<const Index> shape,
                                                       Vector<const Index> starts, Vector<const Index> keys,
                                                       Matrix<const std::int32_t> spans,
                                                       Matrix<const std::int32_t> stored);

/// (n,) numbers of (3, nc) centres closer than R to each of (n, 3) points.
///
/// The last seven arguments find centres near a place: by a grid of all cells as in CentreGrid (origin, inverse side,
/// shape, starts), or, where there are keys, by one that stores few of its cells as in HashedCells (origin, inverse
/// side, keys, spans, stored).
Owned<Index, 1> count_near(Matrix<const double> points, Matrix<const double> centres, double radius,
                           Vector<const double> origin, double inverse_side, Vector<const Index> shape,
                           Vector<const Index> starts, Vector<const Index> keys, Matrix<const std::int32_t> spans,
                           Matrix<const std::int32_t> stored);

/// Columns and entries (e,) of each row of φ between the points and the centres near them, in these centres' order.
///
/// (nc,) numbers are what the columns call the centres; (n + 1,) pointers are those of the rows, by count_near.
void fill_rows(int code, Matrix<const double> points, Matrix<const double> centres, Vector<const Index> numbers,
               double radius, Vector<const double> origin, double inverse_side, Vector<const Index> shape,
               Vector<const Index> starts, Vector<const Index> keys, Matrix<const std::int32_t> spans,
               Matrix<const std::int32_t> stored, Vector<const std::int32_t> pointers, Vector<std::int32_t> columns,
               Vector<double> entries);

}  // namespace mesh_motion
