// A sparse Cholesky factorization of symmetric d × d blocks, for Newton systems that are small enough.
//
// The available general factorizations (SuperLU, QDLDL) treat each number by itself and take 7 to 20 times as long.
#pragma once

#include <tuple>

#include "view.h"

namespace mesh_motion {

/// (order (f), starts (f + 1), rows): the order in which nodes at places (f, d) are eliminated, from nested dissection;
/// and the pattern of the factor below its diagonal, column by column, numbered in that order. The pattern (row_starts,
/// columns) is symmetric.
std::tuple<Owned<std::int32_t, 1>, Owned<Index, 1>, Owned<std::int32_t, 1>> elimination(
    Vector<const Index> row_starts, Vector<const std::int32_t> columns, Matrix<const double> places);

/// The factor of H with the blocks (b, d, d): ``diagonal`` (f, d, d) and ``below`` (r, d, d) in the pattern of
/// elimination(); false unless H is positive definite.
bool block_cholesky(Vector<const Index> row_starts, Vector<const std::int32_t> columns, Cube<const double> blocks,
                    Vector<const std::int32_t> order, Vector<const Index> starts, Vector<const std::int32_t> rows,
                    Cube<double> diagonal, Cube<double> below);

/// Solves H x = right with H's factor, both (f, d). With d = 1 and scalar blocks, for as many columns as both have.
void block_cholesky_solve(Vector<const std::int32_t> order, Vector<const Index> starts, Vector<const std::int32_t> rows,
                          Cube<double> diagonal, Cube<double> below, Matrix<const double> right, Matrix<double> x);

}  // namespace mesh_motion
