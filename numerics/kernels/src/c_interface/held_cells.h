// The cells of a mesh, as the C interface stores them for its callers.
#pragma once

#include <tuple>

#include "c_interface/call.h"
#include "quality/summaries.h"

namespace mesh_motion {

/// A type of cells, and the local nodes of its facets as in numerics/mesh/local_facets.py.
inline constexpr struct Kind {
    const char* name;
    Index dimension, nodes;
    std::array<std::array<Index, 4>, 6> facets;
} cell_types[] = {
    {"line", Line::dimension, Line::nodes,
     {{{0, -1, -1, -1}, {1, -1, -1, -1}, {-1, -1, -1, -1}, {-1, -1, -1, -1}, {-1, -1, -1, -1}, {-1, -1, -1, -1}}}},
    {"triangle", Triangle::dimension, Triangle::nodes,
     {{{0, 1, -1, -1}, {1, 2, -1, -1}, {2, 0, -1, -1}, {-1, -1, -1, -1}, {-1, -1, -1, -1}, {-1, -1, -1, -1}}}},
    {"quad", Quad::dimension, Quad::nodes,
     {{{0, 1, -1, -1}, {1, 2, -1, -1}, {2, 3, -1, -1}, {3, 0, -1, -1}, {-1, -1, -1, -1}, {-1, -1, -1, -1}}}},
    {"tetra", Tetra::dimension, Tetra::nodes,
     {{{0, 2, 1, -1}, {0, 1, 3, -1}, {1, 2, 3, -1}, {0, 3, 2, -1}, {-1, -1, -1, -1}, {-1, -1, -1, -1}}}},
    {"hexahedron", Hexahedron::dimension, Hexahedron::nodes,
     {{{0, 3, 2, 1}, {4, 5, 6, 7}, {0, 1, 5, 4}, {1, 2, 6, 5}, {2, 3, 7, 6}, {3, 0, 4, 7}}}},
    {"wedge", Wedge::dimension, Wedge::nodes,
     {{{0, 2, 1, -1}, {3, 4, 5, -1}, {0, 1, 4, 3}, {1, 2, 5, 4}, {2, 0, 3, 5}, {-1, -1, -1, -1}}}},
    {"pyramid", Pyramid::dimension, Pyramid::nodes,
     {{{0, 3, 2, 1}, {0, 1, 4, -1}, {1, 2, 4, -1}, {2, 3, 4, -1}, {3, 0, 4, -1}, {-1, -1, -1, -1}}}}};

/// In the order of `Metric`.
inline constexpr struct {
    const char* name;
} metrics[] = {{"size"}, {"skew"}, {"size-skew"}, {"size-skew-root"}, {"size-skew-product"}, {"relative-size-skew"}};

}  // namespace mesh_motion

struct mesh_motion_cells {
    mesh_motion::Index dimension = 0, count = 0, nodes = 0;  // of space, of cells, one more than the largest node
    std::vector<std::pair<const mesh_motion::Kind*, std::vector<mesh_motion::Node>>> held;

    mesh_motion::Matrix<const double> points(mesh_motion::Index n, const double* data) const {
        if (n < nodes)
            throw std::invalid_argument("n: expected the " + std::to_string(nodes) + " nodes of the cells, got " +
                                        std::to_string(n));
        return mesh_motion::array("points", data, std::array{n, dimension});
    }

    mesh_motion::Blocks blocks() const {
        mesh_motion::Blocks all;
        for (const auto& [type, nodes] : held)
            all.push_back({nodes.data(), {static_cast<mesh_motion::Index>(nodes.size()) / type->nodes, type->nodes}});
        return all;
    }

    /// Type, number within the type, and nodes of a cell.
    std::tuple<const mesh_motion::Kind*, mesh_motion::Index, const mesh_motion::Node*> at(
        mesh_motion::Index cell) const {
        for (const auto& [type, rows] : held) {
            const auto here = static_cast<mesh_motion::Index>(rows.size()) / type->nodes;
            if (cell < here) return {type, cell, rows.data() + cell * type->nodes};
            cell -= here;
        }
        throw std::out_of_range("no such cell");
    }

    /// Calls f(block, first) for each block, with the number of its first cell.
    template <class F>
    void by_block(F&& f) const {
        mesh_motion::Index first = 0;
        for (const auto& block : blocks()) {
            f(block, first);
            first += block.shape(0);
        }
    }
};
