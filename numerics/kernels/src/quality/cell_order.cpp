#include "quality/cell_order.h"

#include <algorithm>
#include <limits>

#include "parallel.h"

namespace mesh_motion {
namespace {

constexpr Index buckets_at_once = 512, cells_at_once = 1 << 13;

}  // namespace

template <class Order>
Index sort_cells(const std::vector<std::pair<Vector<const Index>, Matrix<const Node>>>& pieces, Index nodes,
                Matrix<Node> rows, Vector<Order> order) {
    const Index m = rows.shape(0), width = rows.shape(1);
    require(nodes <= std::numeric_limits<Node>::max(), "nodes: expected fewer than 2³¹");
    require(width > 0 && nodes >= 0, "rows: expected at least one column; nodes: expected a count");
    Index total = 0;
    std::vector<Index> place(nodes + 1);  // the place of the next row with this first node
    for (const auto& [map, cells] : pieces) {
        require(cells.shape(1) == width, "pieces: expected cells of one type");
        total += cells.shape(0);
        for (Index node : map) require(node >= 0 && node < nodes, "pieces: expected new numbers below `nodes`");
        for_ranges(cells.shape(0), cells_at_once, [&](Index first, Index last) {
            for (Index e = first; e < last; ++e) {
                for (Index k = 0; k < width; ++k)
                    require(cells(e, k) >= 0 && cells(e, k) < map.size(),
                            "pieces: expected a new number for each node of the cells");
                count_one(place[map[cells(e, 0)] + 1]);
            }
        });
    }
    require(m == total && order.size() == total, "rows, order: expected a row for each cell");
    for (Index node = 0; node < nodes; ++node) place[node + 1] += place[node];
    const std::vector<Index> starts = place;
    Index before = 0;
    for (const auto& [map, cells] : pieces) {
        for_ranges(cells.shape(0), cells_at_once, [&](Index first, Index last) {
            for (Index e = first; e < last; ++e) {
                const Index at = count_one(place[map[cells(e, 0)]]);  // in any order: the bucket is sorted below
                for (Index k = 0; k < width; ++k) rows(at, k) = static_cast<Node>(map[cells(e, k)]);
                order[at] = static_cast<Order>(before + e);
            }
        });
        before += cells.shape(0);
    }
    std::vector<Index> repeated((nodes + buckets_at_once - 1) / buckets_at_once, m);
    for_ranges(nodes, buckets_at_once, [&](Index first, Index last) {
        std::vector<Node> sorted;
        std::vector<std::pair<Index, Order>> places;  // of a bucket's rows, and their order
        const auto row = [&](Index at) { return rows.data() + at * width; };
        const auto note_repetition = [&](Index begin, Index end) {
            Index& least = repeated[first / buckets_at_once];
            for (Index at = begin + 1; at < end && least == m; ++at)
                if (std::equal(row(at), row(at) + width, row(at - 1))) least = at;
        };
        for (Index node = first; node < last; ++node) {
            const Index begin = starts[node], end = starts[node + 1];
            const auto less = [&](const auto& a, const auto& b) {
                const auto [x, y] = std::mismatch(row(a.first), row(a.first) + width, row(b.first));
                return x == row(a.first) + width ? a.second < b.second : *x < *y;
            };
            places.clear();
            for (Index at = begin; at < end; ++at) places.emplace_back(at, order[at]);
            if (!std::is_sorted(places.begin(), places.end(), less)) {
                std::sort(places.begin(), places.end(), less);
                sorted.clear();
                for (const auto& [at, number] : places) sorted.insert(sorted.end(), row(at), row(at + 1));
                std::copy(sorted.begin(), sorted.end(), row(begin));
                for (Index at = begin; at < end; ++at) order[at] = places[at - begin].second;
            }
            note_repetition(begin, end);
        }
    });
    const Index least = repeated.empty() ? m : *std::min_element(repeated.begin(), repeated.end());
    return least == m ? -1 : least;
}

template Index sort_cells(const std::vector<std::pair<Vector<const Index>, Matrix<const Node>>>&, Index, Matrix<Node>,
                         Vector<std::int32_t>);
template Index sort_cells(const std::vector<std::pair<Vector<const Index>, Matrix<const Node>>>&, Index, Matrix<Node>,
                         Vector<Index>);

Index first_row_with_repetition(Matrix<const Node> nodes) {
    const Index m = nodes.shape(0), width = nodes.shape(1);
    for (Index e = 0; e < m; ++e)
        for (Index i = 0; i < width; ++i)
            for (Index j = 0; j < i; ++j)
                if (nodes(e, i) == nodes(e, j)) return e;
    return -1;
}

}  // namespace mesh_motion
