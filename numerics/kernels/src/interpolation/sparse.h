// Products of sparse matrices with a few vectors at once, and conjugate gradients with a factorized sparse inverse.
#pragma once

#include "view.h"

namespace mesh_motion {

/// out[rows[i]] += Σ_e entries[e] weights[columns[e]] over e = pointers[i] … pointers[i + 1] − 1, with separate sums of
/// even and odd terms.
///
/// rows (r), pointers (r + 1), columns and entries (e), weights (nc, k), out (n, k); no row twice.
void add_product(Vector<const Index> rows, Vector<const std::int32_t> pointers, Vector<const std::int32_t> columns,
                 Vector<const double> entries, Matrix<const double> weights, Matrix<double> out);

/// The transpose of add_product: out (nc, k) = the product of the transposed matrix and weights (n, k).
void transposed_product(Vector<const Index> rows, Vector<const std::int32_t> pointers,
                        Vector<const std::int32_t> columns, Vector<const double> entries, Matrix<const double> weights,
                        Matrix<double> out);

/// Conjugate gradients for right-hand sides (n, k) that advance together, until no number of the residual is larger
/// than the limit, or for `most` iterations; returns the number of iterations.
///
/// The matrix is in compressed rows, and so are G and Gᵀ, whose product is its approximate inverse. residual (n, k) is
/// the right-hand side at first.
Index solve_sparse(Vector<const std::int32_t> pointers, Vector<const std::int32_t> columns,
                   Vector<const double> entries, Vector<const std::int32_t> factor_pointers,
                   Vector<const std::int32_t> factor_columns, Vector<const double> factor_entries,
                   Vector<const std::int32_t> transposed_pointers, Vector<const std::int32_t> transposed_columns,
                   Vector<const double> transposed_entries, double limit, Index most, Matrix<double> residual,
                   Matrix<double> solution);

/// (k) products of the columns of a and b (n, k).
Owned<double, 1> column_products(Matrix<const double> a, Matrix<const double> b);

/// x += α p, r −= α q for vectors (n, k), with one α (k) for each column.
void advance_columns(Matrix<double> x, Matrix<double> r, Matrix<const double> p, Matrix<const double> q,
                     Vector<const double> alpha);

/// p = z + β p.
void redirect_columns(Matrix<double> p, Matrix<const double> z, Vector<const double> beta);

/// Rows of G with A⁻¹ ≈ Gᵀ G for A_ij = φ(|x_i − x_j| / R): rows (n, count + 1) has the entries of the neighbours
/// (n, count), farthest first, then the diagonal's entry. Neighbours are nearest first; missing ones are −1 at the end.
void sparse_inverse_rows(int code, Matrix<const double> points, Matrix<const Index> neighbours, double inverse_radius,
                         Matrix<double> rows);

}  // namespace mesh_motion
