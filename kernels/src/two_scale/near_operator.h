// A compact level at given places: the product of a sparse matrix with few columns, at some rows.
#pragma once

#include "view.h"

namespace mesh_motion {

/// out[rows[i]] += Σ_e entries[e] weights[columns[e]] over e = pointers[i] … pointers[i + 1] − 1.
///
/// rows (r), pointers (r + 1), columns and entries (e), weights (nc, k), out (n, k); no row twice.
void add_product(Vector<const Index> rows, Vector<const std::int32_t> pointers, Vector<const std::int32_t> columns,
                 Vector<const double> entries, Matrix<const double> weights, Matrix<double> out);

}  // namespace mesh_motion
