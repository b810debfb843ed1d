#include "far_field/box_tree.h"

#include <algorithm>
#include <limits>

namespace mesh_motion {
namespace {

template <class T>
Owned<T, 2> matrix(std::vector<T> values, Index columns) {
    const auto rows = static_cast<Index>(values.size()) / columns;
    return {std::move(values), {rows, columns}};
}

}  // namespace

std::tuple<Owned<Index, 1>, Owned<Index, 2>, Owned<Index, 2>, Owned<Index, 1>, Owned<double, 2>, Owned<double, 2>>
build_box_tree(Vector<const Index> codes, Matrix<const double> points, int d, Index leaf) {
    require(codes.size() > 0 && points.shape(0) == codes.size() && points.shape(1) == 3,
            "codes, points: expected (n,), (n, 3) of at least one point");
    require(1 <= d && d <= 3, "d: expected one, two or three dimensions");
    require(codes[0] >= 0 && std::is_sorted(codes.begin(), codes.end()), "codes: expected them sorted, from 0 on");
    std::vector<Index> parent{-1}, points_of{0, codes.size()}, children_of, levels{0, 1};
    const auto boxes = [&] { return static_cast<Index>(parent.size()); };
    for (Index box = 0; box < boxes(); ++box) {
        if (box == levels.back()) levels.push_back(boxes());  // the first of a level: those before it have no more
        Index first = points_of[2 * box];
        const Index last = points_of[2 * box + 1], shared = codes[first] ^ codes[last - 1];
        children_of.push_back(boxes());
        if (last - first > leaf && shared != 0) {
            int shift = 0;
            while (shared >> (shift + d)) shift += d;
            while (first < last) {
                const Index* end = std::upper_bound(codes.data() + first, codes.data() + last, codes[first] >> shift,
                                                    [&](Index digit, Index code) { return digit < code >> shift; });
                parent.push_back(box);
                points_of.push_back(first);
                points_of.push_back(first = end - codes.data());
            }
        }
        children_of.push_back(boxes());
    }
    constexpr double far = std::numeric_limits<double>::infinity();
    std::vector<double> low(3 * parent.size(), far), high(3 * parent.size(), -far);
    for (Index box = boxes(); box-- > 0;) {  // children first
        const auto widen = [&](Index m, double lower, double upper) {
            low[3 * box + m] = std::min(low[3 * box + m], lower);
            high[3 * box + m] = std::max(high[3 * box + m], upper);
        };
        for (Index m = 0; m < 3; ++m) {
            if (children_of[2 * box] == children_of[2 * box + 1])
                for (Index i = points_of[2 * box]; i < points_of[2 * box + 1]; ++i)
                    widen(m, points(i, m), points(i, m));
            for (Index child = children_of[2 * box]; child < children_of[2 * box + 1]; ++child)
                widen(m, low[3 * child + m], high[3 * child + m]);
        }
    }
    return {owned(std::move(parent)), matrix(std::move(points_of), 2), matrix(std::move(children_of), 2),
            owned(std::move(levels)), matrix(std::move(low), 3), matrix(std::move(high), 3)};
}

}  // namespace mesh_motion
