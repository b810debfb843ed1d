// Corners and cells of the free nodes of a region, the pattern of its Hessian, and sums at the nodes.
//
// Nodes are numbered with the free ones first. Each node's sums go over fixed lists: no atomics, and the same sums in
// the same order for any number of threads. For free node i of f, entries[starts[i]] … entries[starts[i + 1] − 1] are
// `cell · k + place`: the cells (or corners) that have the node, and its place among their k nodes. slots (e, k): the
// position, among the Hessian's blocks, of the node's coupling to each node of that cell, −1 for a held node. Rows of
// blocks begin at row_starts (f + 1), with the diagonal's block; columns (b).
#pragma once

#include <tuple>

#include "view.h"

namespace mesh_motion {

/// Marks (m) the cells (m, k) that have a marked (n) node.
Owned<std::uint8_t, 1> touched_cells(Matrix<const Node> cells, Vector<const bool> marked);

/// (starts, entries, slots, row_starts, columns) of corners (c, d + 1). The free nodes of a pair of `diagonals` (h, 2),
/// which share a cell but no corner, have blocks too.
std::tuple<Owned<Index, 1>, Owned<std::int32_t, 1>, Owned<std::int32_t, 2>, Owned<Index, 1>, Owned<std::int32_t, 1>>
node_adjacency(Matrix<const std::int32_t> corners, Index n_free, Index n_nodes, Matrix<const Index> diagonals);

/// (starts, entries, slots) of cells (m, k) in a given pattern.
std::tuple<Owned<Index, 1>, Owned<std::int32_t, 1>, Owned<std::int32_t, 2>> cell_adjacency(
    Matrix<const std::int32_t> cells, Index n_free, Index n_nodes, Vector<const Index> row_starts,
    Vector<const std::int32_t> columns);

/// sums (f, d) of the shares (c, k, d) at each free node.
void gather_shares(Vector<const Index> starts, Vector<const std::int32_t> entries, Cube<const double> shares,
                   Matrix<double> sums);

/// Recomputes those rows of the Hessian (b, d, d) that have a corner of weight (c) at least least_weight, from the
/// corners' blocks (c, d², d²), see distortion.h.
void assemble_corners(Vector<const Index> starts, Vector<const std::int32_t> entries, Matrix<const std::int32_t> slots,
                      Vector<const Index> row_starts, Cube<const float> blocks, Vector<const double> weights,
                      double least_weight, Cube<double> hessian);

/// hessian (b, d, d) += the blocks (k, d², d²) of some corners; rows (c) has the number of each corner's block, or −1.
void add_corners(Vector<const Index> starts, Vector<const std::int32_t> entries, Matrix<const std::int32_t> slots,
                 Vector<const std::int32_t> rows, Cube<const double> blocks, Cube<double> hessian);

/// For corners with the maps P, ideals (c, d, d), whose rows are the gradients of the shape functions of nodes 1 … d at
/// rest: stiffness (b) += the products of both nodes' gradients, times the corner's weight (c); mass (f) += the weight
/// times |det P|^(2/d), one over the square of the corner's size.
void add_penalty(Vector<const Index> starts, Vector<const std::int32_t> entries, Matrix<const std::int32_t> slots,
                 Cube<const double> ideals, Vector<const double> weights, Vector<double> stiffness,
                 Vector<double> mass);

/// hessian (b, d, d) += the cells' blocks (m, k², d²).
void add_cells(Vector<const Index> starts, Vector<const std::int32_t> entries, Matrix<const std::int32_t> slots,
               Cube<const float> blocks, Cube<double> hessian);

}  // namespace mesh_motion
