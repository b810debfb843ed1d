#include "mesh/facets.h"

#include <algorithm>
#include <bit>
#include <limits>

#include "parallel.h"

namespace mesh_motion {
namespace {

constexpr Index none = std::numeric_limits<Index>::max();
constexpr Index nodes_per_task = 512, cells_per_task = 1 << 12;
constexpr Index ahead = 16;  // number of cells to prefetch: in random order, each cell would be a wait for memory

/// Cells of one type, and the local nodes of their facets.
struct Block {
    Matrix<const Node> nodes;  // (cells, width)
    Index first, width;         // number of the first cell, nodes of a cell
    int facets = 0;
    std::array<std::array<int, 4>, facets_per_cell> local{};
    std::array<int, facets_per_cell> sizes{};
    bool simplex;
    std::array<Index, 4> without{};  // for simplices: the facet opposite each local node

    Block(Matrix<const Node> its_nodes, Index its_first, Matrix<const Index> table)
        : nodes(its_nodes), first(its_first), width(its_nodes.shape(1)) {
        for (; facets < table.shape(0) && table(facets, 0) >= 0; ++facets)
            for (int& size = sizes[facets]; size < 4 && table(facets, size) >= 0; ++size) {
                require(table(facets, size) < width, "local: expected local nodes");
                local[facets][size] = static_cast<int>(table(facets, size));
            }
        simplex = facets == width && std::all_of(sizes.begin(), sizes.begin() + facets,
                                                 [&](int size) { return size == width - 1; });
        require(simplex || *std::min_element(sizes.begin(), sizes.begin() + facets) > 1, "local: expected facets");
        for (int f = 0; simplex && f < facets; ++f) {
            Index node = width * (width - 1) / 2;
            for (int i = 0; i < sizes[f]; ++i) node -= local[f][i];
            require(0 <= node && node < width, "local: expected the facets of a simplex");
            without[node] = f;
        }
    }

    Index end() const { return first + nodes.shape(0); }
    Vector<const Node> cell(Index number) const { return nodes[number - first]; }

    /// The local number of a facet's smallest node.
    int smallest(Vector<const Node> cell, int f) const {
        int place = 0;
        for (int i = 1; i < sizes[f]; ++i)
            if (cell[local[f][i]] < cell[local[f][place]]) place = i;
        return place;
    }

    /// Calls visit(node) for the different smallest nodes of a cell's facets. In a simplex, the smallest node is that
    /// of all facets but one; the remaining facet has the second smallest node.
    template <class Visit>
    void for_smallest(Vector<const Node> cell, Visit&& visit) const {
        if (simplex) {
            Node a = std::min(cell[0], cell[1]), b = std::max(cell[0], cell[1]);
            for (Index i = 2; i < width; ++i) {
                b = std::min(b, std::max(a, cell[i]));
                a = std::min(a, cell[i]);
            }
            visit(a);
            visit(b);
            return;
        }
        std::array<Index, facets_per_cell> seen;
        auto end = seen.begin();
        for (int f = 0; f < facets; ++f) {
            const Index node = cell[local[f][smallest(cell, f)]];
            if (std::find(seen.begin(), end, node) == end) visit(*end++ = node);
        }
    }
};

std::vector<Block> described(Vector<const Node> nodes, Matrix<const Index> blocks, Cube<const Index> local) {
    require(blocks.shape(1) == 2 && local.shape(0) == blocks.shape(0), "blocks, local: expected shapes (b, 2), (b, f, 4)");
    require(local.shape(1) <= facets_per_cell && local.shape(2) == 4, "local: expected at most 8 facets of 4 nodes");
    std::vector<Block> found;
    Index begin = 0, first = 0;
    for (Index b = 0; b < blocks.shape(0); ++b) {
        const Index cells = blocks(b, 0), width = blocks(b, 1);
        require(2 <= width && width <= 8 && 0 <= cells && cells <= (nodes.size() - begin) / width,
                "blocks: expected cells of 2 to 8 nodes, as many as there are nodes for");
        found.emplace_back(Matrix<const Node>(nodes.data() + begin, {cells, width}), first, local[b]);
        begin += cells * width;
        first += cells;
    }
    require(begin == nodes.size(), "nodes: expected those of the cells");
    require(first <= std::numeric_limits<std::uint32_t>::max(), "expected fewer cells than 2³²");
    return found;
}

/// Groups cells that have a facet with the same smallest node, by a counting sort of cell numbers.
struct Buckets {
    std::vector<Index> starts;  // (n + 2,), the last one unused
    std::vector<std::uint32_t> cells;

    Buckets(const std::vector<Block>& blocks, Index n) : starts(n + 2) {
        const auto each = [&](auto&& f) {
            for (const Block& block : blocks)
                for_ranges(block.nodes.shape(0), cells_per_task, [&](Index first, Index last) {
                    for (Index cell = block.first + first; cell < block.first + last; ++cell)
                        block.for_smallest(block.cell(cell), [&](Index node) { f(node, cell); });
                });
        };
        each([&](Index node, Index) { count_one(starts[node + 2]); });
        for (Index node = 2; node < n + 2; ++node) starts[node] += starts[node - 1];
        cells.resize(starts[n + 1]);
        each([&](Index node, Index cell) { cells[count_one(starts[node + 1])] = static_cast<std::uint32_t>(cell); });
    }

    /// Sorts the cells of nodes first … last − 1 by their numbers, because threads have filled them in any order.
    void sort(Index first, Index last) {
        for (Index node = first; node < last; ++node)
            std::sort(cells.begin() + starts[node], cells.begin() + starts[node + 1]);
    }
};

/// A facet, described by its nodes other than the smallest one. Two cells that share it see it from different sides.
/// The side is 1 if, going round the facet from its smallest node as seen from outside the cell, the smaller neighbour
/// comes first.
struct Facet {
    Index key, fourth;  // the two smaller nodes, and the last one of a quad
    Index number;
    bool side;
};

/// The results of one task.
struct Found {
    std::vector<Index> single;
    std::vector<std::array<Index, 2>> pairs;
    Index crowded = none;
};

class Matcher {
  public:
    Matcher(Index n, Found& found, bool pairs) : n_(n), found_(found), pairs_(pairs) {}

    void start(Index node) {
        node_ = node;
        facets_.clear();
    }

    /// Adds the cell's facets that have this smallest node.
    void add(const Block& block, Index number) {
        const Vector<const Node> cell = block.cell(number);
        const Index tag = facets_per_cell * number;
        if (block.simplex) {
            switch (block.width) {
                case 2: return add_simplex<2>(block, cell, tag);
                case 3: return add_simplex<3>(block, cell, tag);
                default: return add_simplex<4>(block, cell, tag);
            }
        }
        for (int f = 0; f < block.facets; ++f) {
            const int place = block.smallest(cell, f), size = block.sizes[f];
            const auto at = [&](int i) { return Index{cell[block.local[f][i]]}; };
            if (at(place) != node_) continue;
            if (size == 2) {
                facets_.push_back({at(1 - place), -1, tag + f, place == 0});
                continue;
            }
            const Index after = at((place + 1) % size), before = at((place + size - 1) % size);
            Index low = std::min(after, before), middle = std::max(after, before), last = -1;
            if (size == 4) {
                last = at((place + 2) % 4);
                if (last < middle) std::swap(middle, last);
                if (middle < low) std::swap(low, middle);
            }
            facets_.push_back({low * n_ + middle, last, tag + f, after < before});
        }
    }

    /// Finds equal facets.
    void match() {
        // open addressing, less than half full: about as many comparisons as facets, even for a node with many facets
        const std::size_t size = std::bit_ceil(2 * facets_.size() + 1);
        const int shift = 64 - std::countr_zero(size);
        slots_.assign(size, -1);
        groups_.clear();
        for (const Facet& facet : facets_) {
            const auto mixed = static_cast<std::uint64_t>(facet.key ^ (facet.fourth << 20)) * 0x9E3779B97F4A7C15u;
            std::size_t slot = mixed >> shift;
            while (slots_[slot] >= 0 && !same(facets_[groups_[slots_[slot]].first], facet)) slot = (slot + 1) % size;
            const auto i = static_cast<int>(&facet - facets_.data());
            if (slots_[slot] < 0) {
                slots_[slot] = static_cast<int>(groups_.size());
                groups_.push_back({i, -1});
            } else if (Group& group = groups_[slots_[slot]]; group.second < 0) {
                group.second = i;
                if (facets_[group.first].side == facet.side) crowd(facets_[group.first].number);
            } else {
                crowd(facets_[group.first].number);
            }
        }
        for (const Group& group : groups_) {
            if (group.second < 0)
                found_.single.push_back(facets_[group.first].number);
            else if (pairs_)
                found_.pairs.push_back({facets_[group.first].number, facets_[group.second].number});
        }
    }

  private:
    struct Group {
        int first, second;
    };

    static bool same(const Facet& a, const Facet& b) { return a.key == b.key && a.fourth == b.fourth; }
    void crowd(Index number) { found_.crowded = std::min(found_.crowded, number); }

    /// The facet of a simplex without the j-th of its sorted nodes is seen from side 1 − j mod 2, or from the other
    /// side if sorting took an odd number of exchanges. Two bits of each entry keep the local node, so that sorting has
    /// no branch.
    template <int count>
    void add_simplex(const Block& block, Vector<const Node> cell, Index tag) {
        std::array<Index, count> sorted;
        for (int i = 0; i < count; ++i) sorted[i] = 4 * Index{cell[i]} + i;
        bool odd = false;
        const auto exchange = [&](int i, int j) {
            const Index a = sorted[i], b = sorted[j];
            odd ^= b < a;
            sorted[i] = std::min(a, b);
            sorted[j] = std::max(a, b);
        };
        for (int end = count - 1; end > 0; --end)
            for (int i = 0; i < end; ++i) exchange(i, i + 1);
        const bool least = node_ == sorted[0] >> 2;
        for (int j = least; j < (least ? count : 1); ++j) {
            Index key = 0;
            for (int i = 0, seen = 0; i < count; ++i)
                if (i != j && seen++ > 0) key = key * n_ + (sorted[i] >> 2);
            facets_.push_back({key, -1, tag + block.without[sorted[j] & 3], (j % 2 == 0) != odd});
        }
    }

    Index n_, node_ = 0;
    Found& found_;
    bool pairs_;
    std::vector<Facet> facets_;
    std::vector<int> slots_;
    std::vector<Group> groups_;
};

}  // namespace

std::tuple<Owned<Index, 1>, Owned<Index, 2>, Index> match_facets(Vector<const Node> nodes, Matrix<const Index> blocks,
                                                                 Cube<const Index> local, bool pairs) {
    const std::vector<Block> cells = described(nodes, blocks, local);
    Index n = 0;
    for (Index node : nodes) n = std::max(n, node + 1);
    require_below(nodes, n, "nodes: expected numbers from 0 on");
    Buckets buckets(cells, n);

    std::vector<Found> found((n + nodes_per_task - 1) / nodes_per_task);
    for_ranges(n, nodes_per_task, [&](Index first, Index last) {
        buckets.sort(first, last);
        Found own;
        Matcher matcher(n, own, pairs);
        const auto block_of = [&](Index number) {
            auto block = cells.begin();
            while (number >= block->end()) ++block;
            return block;
        };
        for (Index node = first; node < last; ++node) {
            matcher.start(node);
            for (Index e = buckets.starts[node]; e < buckets.starts[node + 1]; ++e) {
                if (const Index next = e + ahead; next < buckets.starts[last])
                    __builtin_prefetch(&block_of(buckets.cells[next])->cell(buckets.cells[next])[0]);
                matcher.add(*block_of(buckets.cells[e]), buckets.cells[e]);
            }
            matcher.match();
        }
        found[first / nodes_per_task] = std::move(own);
    });

    std::vector<Index> single;
    std::vector<std::array<Index, 2>> both;
    Index crowded = none;
    for (Found& part : found) {
        single.insert(single.end(), part.single.begin(), part.single.end());
        both.insert(both.end(), part.pairs.begin(), part.pairs.end());
        crowded = std::min(crowded, part.crowded);
        part = {};
    }
    std::sort(single.begin(), single.end());
    std::sort(both.begin(), both.end(), [](const auto& a, const auto& b) {
        const auto cell = [](Index number) { return number / facets_per_cell; };
        return std::tuple(cell(a[0]), cell(a[1]), a[0]) < std::tuple(cell(b[0]), cell(b[1]), b[0]);
    });
    Owned<Index, 2> matched{{}, {static_cast<Index>(both.size()), 2}};
    matched.values.reserve(2 * both.size());
    for (const auto& pair : both) matched.values.insert(matched.values.end(), pair.begin(), pair.end());
    return {owned(std::move(single)), std::move(matched), crowded == none ? -1 : crowded};
}

}  // namespace mesh_motion
