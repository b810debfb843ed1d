// Sparse matrices times few vectors at once, and conjugate gradients with a factorized sparse inverse.
#pragma once

#include "view.h"

namespace mesh_motion {

/// product (m, k) of a matrix in compressed rows with vectors (n, k), each row in stored order, even and odd terms
/// apart.
void sparse_product(Vector<const std::int32_t> pointers, Vector<const std::int32_t> columns,
                    Vector<const double> entries, Matrix<const double> vectors, Matrix<double> product);

/// (k) products of the columns of a and b (n, k).
Owned<double, 1> column_products(Matrix<const double> a, Matrix<const double> b);

/// x += α p, r −= α q for vectors (n, k), each column by its own α (k).
void advance_columns(Matrix<double> x, Matrix<double> r, Matrix<const double> p, Matrix<const double> q,
                     Vector<const double> alpha);

/// p = z + β p.
void redirect_columns(Matrix<double> p, Matrix<const double> z, Vector<const double> beta);

/// Rows of G with A⁻¹ ≈ Gᵀ G for A_ij = φ(|x_i − x_j| / R): rows (n, count + 1) has the entries of the neighbours
/// (n, count), farthest first, then the diagonal's. Neighbours are nearest first and end with −1 where there are fewer.
void sparse_inverse_rows(int code, Matrix<const double> points, Matrix<const Index> neighbours, double inverse_radius,
                         Matrix<double> rows);

}  // namespace mesh_motion
