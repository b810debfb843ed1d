#include "quality/inversion.h"

#include <array>
#include <cmath>
#include <iterator>
#include <limits>
#include <numeric>

#include "cubic.h"
#include "parallel.h"
#include "quality/jacobians.h"
#include "quality/order_statistics.h"

namespace mesh_motion {
namespace {

constexpr Index sampled = 1 << 12;  // number of groups of cells, each with a sample
constexpr Index least_group = 8;    // cells in a group; in smaller meshes all cells are looked at
constexpr double least_reach = 1.25, unlike = 2.0;  // groups are looked at up to such a multiple of the limit
constexpr Index together = 32;      // cells of which positions and motion fit into the fastest cache
constexpr double nearly = 0.1;      // of its size now: a sample so small counts, for a neighbour may invert
constexpr double never = std::numeric_limits<double>::infinity();

/// det(E + s V) of one corner of cell s.
template <int d>
[[gnu::always_inline]] inline Cubic determinant_of(const Jacobians<d>& now, const Jacobians<d>& before, Index s) {
    std::array<Vector3, d> edges{}, on{};
    for (int j = 0; j < d; ++j)
        for (int i = 0; i < d; ++i) {
            edges[j][i] = now.entry[i][j][s];
            on[j][i] = now.entry[i][j][s] - before.entry[i][j][s];
        }
    return determinant_along<d>(edges, on);
}

/// Steps (m,) until a corner determinant of the cells with these nodes (m, k) is `left` times its present value, up to the
/// horizon.
template <class Type>
void until_inverted(Matrix<const double> points, Matrix<const double> start, Matrix<const Node> nodes, double left,
                    double horizon, double* steps) {
    constexpr int d = Type::dimension;
    for (Index first = 0; first < nodes.shape(0); first += together) {
        const Index count = std::min(together, nodes.shape(0) - first);
        const Rows rows(points, nodes, first, count);
        const auto positions = from_points<Type>(points, count, rows.cells<Type>(), rows.inside);
        const auto starts = from_points<Type>(start, count, rows.cells<Type>(), rows.inside);
        Jacobians<d> now, before;
        double* found = steps + first;
        const auto always = [](double) { return true; };
        std::fill_n(found, count, never);
        for (int k = 0; k < static_cast<int>(Type::corners.size()); ++k) {
            positions(k, now);
            starts(k, before);
            Index may[together], any = 0;
            const auto above_left = [&](Index s) {
                Cubic p = determinant_of<d>(now, before, s);
                p[0] -= left * p[0];
                return p;
            };
            for (Index s = 0; s < count; ++s) any += may[s] = may_fall(above_left(s), horizon);
            for (Index s = 0; any && s < count; ++s) {
                if (!may[s]) continue;
                const Cubic p = above_left(s);
                found[s] = p[0] > 0.0 ? std::min(found[s], first_root(p, std::min(horizon, found[s]), always)) : 0.0;
            }
        }
    }
}

using UntilInverted = void (*)(Matrix<const double>, Matrix<const double>, Matrix<const Node>, double, double, double*);

/// Steps to inversion of the cells of several blocks with consecutive numbers.
class Inversions {
  public:
    Inversions(Matrix<const double> points, Matrix<const double> before, const std::vector<Matrix<const Node>>& blocks)
        : points_(points), before_(before) {
        for (const auto& nodes : blocks) {
            const auto until = with_cell_type(points.shape(1), nodes.shape(1),
                                              []<class Type>(Type) -> UntilInverted { return until_inverted<Type>; });
            blocks_.push_back({nodes, size_, until});
            size_ += nodes.shape(0);
        }
    }

    Index size() const { return size_; }

    /// Adds the cells first … last − 1 with their steps, up to the limit; returns the least one.
    double add(Index first, Index last, double limit, Lowest& lowest) const {
        double least = never;
        for (const Block& block : blocks_) {
            const Index from = std::max(first, block.first), to = std::min(last, block.first + block.nodes.shape(0));
            for_chunks(from, to, [&](Index begin, Index count) {
                double steps[chunk];
                const Index row = begin - block.first;
                block.until(points_, before_, block.nodes.rows(row, row + count), 0.0, limit, steps);
                lowest.add(steps, begin, count, limit);
                least = std::min(least, *std::min_element(steps, steps + count));
            });
        }
        return least;
    }

    /// Steps of cells with ascending numbers until `left` of a determinant is left, up to the limit.
    std::vector<double> of(const std::vector<Index>& numbers, double left, double limit) const {
        std::vector<double> steps(numbers.size());
        for_ranges(static_cast<Index>(numbers.size()), 8 * chunk, [&](Index begin, Index end) {
            std::vector<Node> nodes;
            for (const Block& block : blocks_) {
                nodes.clear();
                const Index from = begin;
                for (; begin < end && numbers[begin] < block.first + block.nodes.shape(0); ++begin) {
                    const auto row = block.nodes[numbers[begin] - block.first];
                    nodes.insert(nodes.end(), row.begin(), row.end());
                }
                const Matrix<const Node> rows(nodes.data(), {begin - from, block.nodes.shape(1)});
                block.until(points_, before_, rows, left, limit, steps.data() + from);
            }
        });
        return steps;
    }

  private:
    struct Block {
        Matrix<const Node> nodes;
        Index first;
        UntilInverted until;
    };
    Matrix<const double> points_, before_;
    std::vector<Block> blocks_;
    Index size_ = 0;
};

/// The first cells of the groups `todo`, each of `width` cells; found[g] becomes the least step of group g.
Lowest looked_at(const Inversions& cells, Index width, const std::vector<Index>& todo, double limit, Index count,
                 std::vector<double>& found) {
    const Index n = static_cast<Index>(todo.size()), together = std::max<Index>(1, judged_at_once / width);
    std::vector<Lowest> lowest((n + together - 1) / together, Lowest(count));
    for_ranges(n, together, [&](Index begin, Index end) {
        Lowest& here = lowest[begin / together];
        for (Index k = begin; k < end; ++k)
            found[todo[k]] = cells.add(todo[k] * width, std::min(cells.size(), (todo[k] + 1) * width), limit, here);
        here.trim();
    });
    Lowest all(count);
    for (const Lowest& part : lowest) all.add(part);
    return all;
}

/// The `count` cells that invert first, up to the horizon.
Lowest first_of(const Inversions& cells, Vector<const Index> near, double horizon, Index count) {
    const Index m = cells.size(), width = std::max<Index>(1, m / sampled), groups = (m + width - 1) / width;
    double limit = horizon;
    const auto lower_limit = [&](std::vector<double> steps) {
        if (count <= static_cast<Index>(steps.size()))
            limit = std::min(limit, (1.0 + 1e-9) * select(steps, count - 1));  // roots are rounded
    };
    std::vector<Index> starts, samples, some;
    for (Index c = 0; c < m; c += width) starts.push_back(c);
    std::set_union(starts.begin(), starts.end(), near.begin(), near.end(), std::back_inserter(samples));
    for (std::size_t k = 0; k < samples.size(); k += 8) some.push_back(samples[k]);
    lower_limit(cells.of(some, 0.0, horizon));
    const std::vector<double> steps = cells.of(samples, nearly, unlike * limit);
    std::vector<double> least(groups, never), found(groups, never);  // of the samples of a group; of all its cells
    for (std::size_t k = 0; k < samples.size(); ++k) {
        const Index g = samples[k] / width;
        least[g] = std::min(least[g], steps[k]);
        if (g > 0 && samples[k] == g * width) least[g - 1] = std::min(least[g - 1], steps[k]);
    }

    // a step is rough if most cells at the first samples do not invert at nearly the same s
    std::vector<Index> order(groups);
    std::iota(order.begin(), order.end(), Index{0});
    const auto by_least = [&](Index a, Index b) { return std::pair(least[a], a) < std::pair(least[b], b); };
    const Index probes = std::min<Index>(groups, 8);
    std::partial_sort(order.begin(), order.begin() + probes, order.end(), by_least);
    Index early = 0, rough = 0;
    std::vector<double> roots;
    for (Index k = 0; k < probes && width >= least_group && least[order[k]] < never; ++k, ++early) {
        std::vector<Index> own(std::min(width, m - order[k] * width));
        std::iota(own.begin(), own.end(), order[k] * width);
        std::vector<double> its = cells.of(own, nearly, unlike * least[order[k]]);
        rough += select(its, static_cast<Index>(its.size()) / 2) == never;
        its = cells.of(own, 0.0, limit);
        roots.insert(roots.end(), its.begin(), its.end());
    }
    lower_limit(roots);

    double reach = width < least_group || 2 * rough > early ? unlike : least_reach;
    std::vector<char> seen(groups);
    Lowest first(count);
    while (reach < unlike) {
        std::vector<Index> todo;
        for (Index g = 0; g < groups; ++g)
            if (!seen[g] && least[g] <= reach * limit) todo.push_back(g);
        if (todo.empty()) return first;  // it has all samples up to the limit
        first.add(looked_at(cells, width, todo, limit, count, found));
        for (Index g : todo) seen[g] = 1;
        lower_limit(first.in_order().first);
        for (Index g = 0; g < groups; ++g)
            if (found[g] <= limit && found[g] < least[g])
                reach = std::max(reach, least[g] < unlike * found[g] ? std::pow(least[g] / found[g], 2) : unlike);
    }
    std::vector<Index> all((m + judged_at_once - 1) / judged_at_once);
    std::iota(all.begin(), all.end(), Index{0});
    found.resize(all.size());
    return looked_at(cells, judged_at_once, all, limit, count, found);
}

}  // namespace

std::pair<Owned<double, 1>, Owned<Index, 1>> first_inversions(Matrix<const double> points, Matrix<const double> before,
                                                              const std::vector<Matrix<const Node>>& blocks,
                                                              Vector<const Index> near, double horizon, Index count) {
    require(before.shape() == points.shape(), "before: expected the shape of points");
    require(horizon > 0.0 && count > 0, "horizon, count: expected positive numbers");
    const Inversions cells(points, before, blocks);
    require_below(near, cells.size(), "near: expected numbers of cells");
    require(std::is_sorted(near.begin(), near.end()), "near: expected ascending numbers");
    auto [steps, numbers] = first_of(cells, near, horizon, count).in_order();
    std::vector<Index> inverting(numbers);
    std::sort(inverting.begin(), inverting.end());
    for (Index c = 0, k = 0; c < cells.size() && static_cast<Index>(numbers.size()) < count; ++c) {  // without a root
        if (k < static_cast<Index>(inverting.size()) && inverting[k] == c) {
            ++k;
            continue;
        }
        steps.push_back(never);
        numbers.push_back(c);
    }
    return {owned(std::move(steps)), owned(std::move(numbers))};
}

}  // namespace mesh_motion
