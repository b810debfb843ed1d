#include "mesh/points.h"

#include <numeric>

#include "parallel.h"

namespace mesh_motion {
namespace {

constexpr Index block = 1 << 16;  // numbers in one task: for fewer numbers, waking a thread takes longer

}  // namespace

Owned<double, 2> corners_of(Matrix<const double> points) {
    constexpr Index most = 3 * 8;  // whole points and whole registers, for each dimension
    const Index d = points.shape(1), all = points.size(), width = 8 * d;
    require(all > 0 && d <= 3, "points: expected at least one of 1 to 3 coordinates");
    const Index tasks = (all + block * d - 1) / (block * d);
    std::vector<std::array<double, most>> low(tasks), high(tasks);
    for_ranges(all, block * d, [&](Index first, Index last) {
        std::array<double, most> least, greatest;
        for (Index l = 0; l < width; ++l) least[l] = greatest[l] = points.data()[first + l % d];
        Index at = first;
        const auto note = [&](Index count) {
            for (Index l = 0; l < count; ++l) {
                const double value = points.data()[at + l];
                least[l] = value < least[l] ? value : least[l];
                greatest[l] = value > greatest[l] ? value : greatest[l];
            }
        };
        if (d == 3)
            for (; at + most <= last; at += most) note(most);
        for (; at < last; at += width) note(std::min(width, last - at));
        low[first / (block * d)] = least, high[first / (block * d)] = greatest;
    });
    Owned<double, 2> box{std::vector<double>(2 * d), {2, d}};
    for (Index axis = 0; axis < d; ++axis) {
        double &least = box.values[axis] = low[0][axis], &greatest = box.values[d + axis] = high[0][axis];
        for (Index task = 0; task < tasks; ++task)
            for (Index l = axis; l < width; l += d) {
                least = std::min(least, low[task][l]);
                greatest = std::max(greatest, high[task][l]);
            }
    }
    return box;
}

void add_values(Vector<const double> values, Vector<double> out) {
    require(values.size() == out.size(), "values: expected as many numbers as in out");
    for_ranges(out.size(), block, [&](Index first, Index last) {
        for (Index k = first; k < last; ++k) out[k] += values[k];
    });
}

Index round_differences(Vector<double> moved, Vector<const double> base) {
    require(base.size() == moved.size(), "base: expected as many numbers as in moved");
    std::vector<Index> changed((moved.size() + block - 1) / block);
    for_ranges(moved.size(), block, [&](Index first, Index last) {
        Index count = 0;
        for (Index k = first; k < last; ++k) {
            const double value = base[k] + (moved[k] - base[k]);
            count += value != moved[k];
            moved[k] = value;
        }
        changed[first / block] = count;
    });
    return std::accumulate(changed.begin(), changed.end(), Index{0});
}

void take_differences(Matrix<const double> moved, Matrix<const double> base, Vector<const Index> rows,
                      Matrix<double> found) {
    const Index d = found.shape(1);
    require(moved.shape() == base.shape() && moved.shape(1) == d, "moved, base: expected one shape (n, d)");
    require(rows.size() == found.shape(0), "found: expected a row for each of rows");
    for_ranges(rows.size(), block / 4, [&](Index first, Index last) {
        for (Index j = first; j < last; ++j) {
            require(0 <= rows[j] && rows[j] < base.shape(0), "rows: expected rows of base");
            for (Index c = 0; c < d; ++c) found(j, c) = moved(rows[j], c) - base(rows[j], c);
        }
    });
}

}  // namespace mesh_motion
