// Cell types in the loops: the nodes of each corner, and the ideal corner.
//
// One formula covers all types. With α_k = det A_k, λ_k = A_kᵀ A_k, d the dimension and n the number of corners
//
//     skew = n / Σ_k f_k
//     mean ratio (triangle, tetra, pyramid):  f_k = tr(G λ_k) / d · (det W / |α_k|)^(2/d),   G = W⁻¹ W⁻ᵀ
//     angles (quad, hexahedron, wedge):       f_k = (w Π_i √λ_k,ii / |α_k|)^(2/d),           w = det W / Π_i |W_i|
//
// W is the ideal corner, W_i its columns. The mean ratio is thesis (2.14) for triangles and tetrahedra, the angle form
// is (2.14) for quads and (3.30) for hexahedra. Both are 1 for the ideal cell only and at most 1 for any other: the
// mean ratio by the inequality of the means, the angle form because the sines of a triangle's corners are largest
// together at 60 degrees (wedge) and every sine is at most 1 (quad, hexahedron).
//
// The tables are those of numerics/mesh/cells.py.
#pragma once

#include "view.h"

namespace mesh_motion {

enum class Formula { length, mean_ratio, angles };

template <int corners, int dimension>
using Corners = std::array<std::array<int, dimension + 1>, corners>;

struct Line {
    static constexpr int dimension = 1, nodes = 2;
    static constexpr Formula formula = Formula::length;
    static constexpr Corners<1, 1> corners{{{0, 1}}};
    static constexpr double ideal = 1.0;  // det W of the mean ratio, w of the angles
};

struct Triangle {
    static constexpr int dimension = 2, nodes = 3;
    static constexpr Formula formula = Formula::mean_ratio;
    static constexpr Corners<1, 2> corners{{{0, 1, 2}}};
    static constexpr double ideal = 0.86602540378443865;  // √3/2
    static constexpr double gram[2][2] = {{4.0 / 3.0, -2.0 / 3.0}, {-2.0 / 3.0, 4.0 / 3.0}};
};

struct Quad {
    static constexpr int dimension = 2, nodes = 4;
    static constexpr Formula formula = Formula::angles;
    static constexpr Corners<4, 2> corners{{{0, 1, 3}, {1, 2, 0}, {2, 3, 1}, {3, 0, 2}}};
    static constexpr double ideal = 1.0;
};

struct Tetra {
    static constexpr int dimension = 3, nodes = 4;
    static constexpr Formula formula = Formula::mean_ratio;
    static constexpr Corners<1, 3> corners{{{0, 1, 2, 3}}};
    static constexpr double ideal = 0.70710678118654752;  // √½
    static constexpr double gram[3][3] = {{1.5, -0.5, -0.5}, {-0.5, 1.5, -0.5}, {-0.5, -0.5, 1.5}};
};

struct Hexahedron {
    static constexpr int dimension = 3, nodes = 8;
    static constexpr Formula formula = Formula::angles;
    static constexpr Corners<8, 3> corners{{{0, 1, 3, 4}, {1, 2, 0, 5}, {2, 3, 1, 6}, {3, 0, 2, 7},  // Table 2.4
                                            {4, 7, 5, 0}, {5, 4, 6, 1}, {6, 5, 7, 2}, {7, 6, 4, 3}}};
    static constexpr double ideal = 1.0;
};

struct Wedge {
    static constexpr int dimension = 3, nodes = 6;
    static constexpr Formula formula = Formula::angles;
    static constexpr Corners<6, 3> corners{
        {{0, 1, 2, 3}, {1, 2, 0, 4}, {2, 0, 1, 5}, {3, 5, 4, 0}, {4, 3, 5, 1}, {5, 4, 3, 2}}};
    static constexpr double ideal = 0.86602540378443865;
};

struct Pyramid {
    static constexpr int dimension = 3, nodes = 5;
    static constexpr Formula formula = Formula::mean_ratio;
    static constexpr Corners<4, 3> corners{{{0, 1, 3, 4}, {1, 2, 0, 4}, {2, 3, 1, 4}, {3, 0, 2, 4}}};
    static constexpr double ideal = 0.70710678118654752;
    static constexpr double gram[3][3] = {{1.5, 0.5, -1.0}, {0.5, 1.5, -1.0}, {-1.0, -1.0, 2.0}};
};

/// Calls f(Type{}) for the type whose cells have this number of nodes and dimensions; no two types have the same.
template <class F>
decltype(auto) with_cell_type(Index dimension, Index nodes, F&& f) {
    switch (10 * dimension + nodes) {
        case 12: return f(Line{});
        case 23: return f(Triangle{});
        case 24: return f(Quad{});
        case 34: return f(Tetra{});
        case 38: return f(Hexahedron{});
        case 36: return f(Wedge{});
        case 35: return f(Pyramid{});
        default: throw std::invalid_argument("nodes: no cell type has so many nodes in this dimension");
    }
}

}  // namespace mesh_motion
