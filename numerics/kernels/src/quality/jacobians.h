// The edges at the corners of a chunk of cells, coordinate by coordinate, so that loops over cells fill registers.
#pragma once

#include <cstring>

#include "lanes.h"
#include "quality/cell_quality.h"

namespace mesh_motion {

/// The Jacobians of one corner for a chunk of cells, entry by entry, so that cells are adjacent in memory.
template <int d>
struct alignas(64) Jacobians {
    double entry[d][d][chunk];
};

using Two [[gnu::vector_size(2 * sizeof(double))]] = double;
using Four [[gnu::vector_size(4 * sizeof(double))]] = double;
using Eight [[gnu::vector_size(8 * sizeof(double))]] = double;

/// The coordinates of four positions, by coordinate.
[[gnu::always_inline]] inline std::array<Four, 3> by_coordinate(const std::array<const double*, 4>& at) {
    std::array<Two, 4> xy;
    for (int c = 0; c < 4; ++c) std::memcpy(&xy[c], at[c], sizeof xy[c]);
    const Four even = __builtin_shufflevector(xy[0], xy[2], 0, 1, 2, 3),
               odd = __builtin_shufflevector(xy[1], xy[3], 0, 1, 2, 3);
    return {__builtin_shufflevector(even, odd, 0, 4, 2, 6), __builtin_shufflevector(even, odd, 1, 5, 3, 7),
            Four{at[0][2], at[1][2], at[2][2], at[3][2]}};
}

/// The same for as many positions as a register has lanes; it may read a fourth number after each position.
template <std::size_t count>
[[gnu::always_inline]] inline auto by_coordinate_and_more(const std::array<const double*, count>& at) {
    if constexpr (count == 8) {  // as few instructions as for four; a register: cells 0 and 2, 1 and 3, 4 and 6 …
        std::array<Eight, 4> p;
        for (int c = 0; c < 4; ++c) {
            Four low, high;
            std::memcpy(&low, at[c + (c & 2)], sizeof low);
            std::memcpy(&high, at[c + (c & 2) + 2], sizeof high);
            p[c] = __builtin_shufflevector(low, high, 0, 1, 2, 3, 4, 5, 6, 7);
        }
        const auto even = [](Eight a, Eight b) { return __builtin_shufflevector(a, b, 0, 8, 2, 10, 4, 12, 6, 14); };
        const auto odd = [](Eight a, Eight b) { return __builtin_shufflevector(a, b, 1, 9, 3, 11, 5, 13, 7, 15); };
        const Eight a = even(p[0], p[1]), b = even(p[2], p[3]), c = odd(p[0], p[1]), d = odd(p[2], p[3]);
        return std::array<Eight, 3>{__builtin_shufflevector(a, b, 0, 1, 4, 5, 8, 9, 12, 13),
                                    __builtin_shufflevector(c, d, 0, 1, 4, 5, 8, 9, 12, 13),
                                    __builtin_shufflevector(a, b, 2, 3, 6, 7, 10, 11, 14, 15)};
    } else {
        std::array<Four, 4> p;
        for (int c = 0; c < 4; ++c) std::memcpy(&p[c], at[c], sizeof p[c]);
        const auto even = [](Four a, Four b) { return __builtin_shufflevector(a, b, 0, 4, 2, 6); };
        const auto odd = [](Four a, Four b) { return __builtin_shufflevector(a, b, 1, 5, 3, 7); };
        const Four a = even(p[0], p[1]), b = even(p[2], p[3]), c = odd(p[0], p[1]), d = odd(p[2], p[3]);
        return std::array<Four, 3>{__builtin_shufflevector(a, b, 0, 1, 4, 5), __builtin_shufflevector(c, d, 0, 1, 4, 5),
                                   __builtin_shufflevector(a, b, 2, 3, 6, 7)};
    }
}

/// The nodes of a chunk's cells, checked while they are in the cache.
struct Rows {
    const Node* first;
    bool inside = false;  // no cell has the last point, after which no number may be read

    Rows(Matrix<const double> points, Matrix<const Node> nodes, Index begin, Index count) {
        const auto rows = nodes.rows(begin, begin + count);
        require_below(rows, points.shape(0), "nodes: expected numbers of points");
        first = rows.data();
        const auto last = static_cast<std::uint32_t>(std::min<Index>(points.shape(0) - 2, std::numeric_limits<Node>::max()));
        std::uint32_t signs = 0;
        for (Node node : rows) signs |= last - static_cast<std::uint32_t>(node);
        inside = points.shape(0) > 1 && signs >> 31 == 0;
    }

    template <class Type>
    auto cells() const {
        return [rows = first](Index s) { return rows + s * Type::nodes; };
    }
};

/// Writes the Jacobians of the corners k of cells, from positions; cell(s) are the nodes of cell s.
template <class Type, class Cell>
auto from_points(Matrix<const double> points, Index count, Cell cell, bool inside = false) {
    constexpr int d = Type::dimension;
    return [=](int k, Jacobians<d>& jacobians) {
        const auto& corner = Type::corners[k];
        Index s = 0;
        const auto together = [&]<int number>(std::integral_constant<int, number>, auto take_apart) {
            for (; s + number <= count; s += number) {
                const auto corners = [&](int node) {
                    std::array<const double*, number> at;
                    for (int c = 0; c < number; ++c) at[c] = points.data() + d * Index{cell(s + c)[node]};
                    return take_apart(at);
                };
                const auto origin = corners(corner[0]);
                for (int j = 0; j < d; ++j) {
                    const auto end = corners(corner[j + 1]);
                    for (int i = 0; i < d; ++i) {
                        const auto edge = end[i] - origin[i];
                        std::memcpy(&jacobians.entry[i][j][s], &edge, sizeof edge);
                    }
                }
            }
        };
        if constexpr (d == 3 && register_lanes >= 4) {  // with narrower registers this is slower than one by one
            const auto more = [](const auto& at) { return by_coordinate_and_more(at); };
            if (inside) together(std::integral_constant<int, register_lanes>{}, more);
            else together(std::integral_constant<int, 4>{}, [](const auto& at) { return by_coordinate(at); });
        }
        for (; s < count; ++s) {
            const Node* nodes = cell(s);
            const double* __restrict origin = points.data() + d * Index{nodes[corner[0]]};
            for (int j = 0; j < d; ++j) {
                const double* __restrict end = points.data() + d * Index{nodes[corner[j + 1]]};
                for (int i = 0; i < d; ++i) jacobians.entry[i][j][s] = end[i] - origin[i];
            }
        }
    };
}

/// Calls f(first, count) for the chunks of the cells first … last − 1.
template <class F>
void for_chunks(Index first, Index last, F&& f) {
    for (; first < last; first += chunk) f(first, std::min(chunk, last - first));
}

}  // namespace mesh_motion
