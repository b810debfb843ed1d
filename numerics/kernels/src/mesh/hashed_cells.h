// Points sorted by the cells of a grid that stores only the cells next to a point.
#pragma once

#include <cmath>
#include <tuple>

#include "view.h"

namespace mesh_motion {

/// The grid and the table of its stored cells; each stored cell knows the points of the 27 cells around it.
struct HashedCells {
    static constexpr int bits = 20;  // bits of a cell's number along one axis

    Vector<const double> origin;  // (3,)
    double inverse_side;
    Vector<const Index> keys;           // (t,) the keys of the stored cells, −1 for a free entry; t = 2ⁿ
    Matrix<const std::int32_t> spans;   // (t, 2) [first, last) of each cell's runs
    Matrix<const std::int32_t> runs;    // (r, 2) [first, last) of sorted points

    /// Refuses shapes that do not fit.
    void check() const;

    /// One number for the place of a cell, which is −1 or more along each axis.
    static constexpr Index packed(Index x, Index y, Index z) {
        return ((z + 1) << (2 * bits)) | ((y + 1) << bits) | (x + 1);
    }

    /// The position of a key in the table, or its position if it were there.
    static Index slot(Index key, Vector<const Index> keys) {
        const Index mask = keys.size() - 1;
        Index slot = static_cast<Index>((static_cast<std::uint64_t>(key) * 0x9E3779B97F4A7C15u) >> 32) & mask;
        for (Index tried = 0; keys[slot] >= 0 && keys[slot] != key && tried < mask; ++tried) slot = (slot + 1) & mask;
        return slot;
    }

    /// The key of the cell that contains a place; −1 if there can be no such cell.
    Index key_of(double x, double y, double z) const {
        constexpr double most = (1 << bits) - 2;
        const double px = (x - origin[0]) * inverse_side, py = (y - origin[1]) * inverse_side,
                     pz = (z - origin[2]) * inverse_side;
        const auto whole = [](double v) { return static_cast<Index>(std::floor(v)); };
        const bool inside = -1.0 <= px && px < most && -1.0 <= py && py < most && -1.0 <= pz && pz < most;
        return inside ? packed(whole(px), whole(py), whole(pz)) : -1;
    }

    /// The position of a key in the table; −1 if the key is not there.
    Index place(Index key) const {
        const Index found = key < 0 ? -1 : slot(key, keys);
        return found >= 0 && keys[found] == key ? found : -1;
    }

    /// The runs (m, 2) of sorted points around the cell at a position of the table, at most 27; none for −1.
    Matrix<const std::int32_t> near(Index place) const {
        if (place < 0) return runs.rows(0, 0);
        const Index first = spans(place, 0), last = spans(place, 1);
        require(0 <= first && first <= last && last <= runs.shape(0), "spans: expected numbers of runs");
        return runs.rows(first, last);
    }
};

/// Sorted points and the table that finds the points of a cell.
struct StoredCells {
    Owned<Index, 1> order;         // (n,) row j of the sorted arrays is point order[j]
    Owned<double, 2> coordinates;  // (3, n)
    Owned<double, 1> origin;
    double inverse_side;
    Owned<Index, 1> keys;
    Owned<std::int32_t, 2> spans, runs;
};

/// Sorts points (n, 3), or a part of them, by cells of the given side, or by wider cells if there would be a million
/// along an axis. No point is below the origin (3,), and no point is further than `extent` from it along an axis.
StoredCells store_cells(Matrix<const double> points, Vector<const double> origin, double extent, double side);

}  // namespace mesh_motion
