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
constexpr double least_reach = 1.15, unlike = 2.0;  // groups are looked at up to such a multiple of the limit
constexpr double margin = 1.15;     // by which a group may be earlier, compared with its samples, than those seen
constexpr Index together = 32;      // cells of which positions and motion fit into the fastest cache
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

/// Calls f(now, before, count, first) for the edges of each corner of the cells with these nodes (m, k), part by part.
template <class Type, class F>
void for_corners(Matrix<const double> points, Matrix<const double> start, Matrix<const Node> nodes, F&& f) {
    for (Index first = 0; first < nodes.shape(0); first += together) {
        const Index count = std::min(together, nodes.shape(0) - first);
        const Rows rows(points, nodes, first, count);
        const auto positions = from_points<Type>(points, count, rows.cells<Type>(), rows.inside);
        const auto starts = from_points<Type>(start, count, rows.cells<Type>(), rows.inside);
        Jacobians<Type::dimension> now, before;
        for (int k = 0; k < static_cast<int>(Type::corners.size()); ++k) {
            positions(k, now);
            starts(k, before);
            f(now, before, count, first);
        }
    }
}

/// Steps (m,) until a corner determinant of the cells is 0, up to the horizon.
template <class Type>
void until_inverted(Matrix<const double> points, Matrix<const double> start, Matrix<const Node> nodes, double horizon,
                    double* steps) {
    std::fill_n(steps, nodes.shape(0), never);
    for_corners<Type>(points, start, nodes, [&](const auto& now, const auto& before, Index count, Index first) {
        constexpr int d = Type::dimension;
        double* found = steps + first;
        const auto always = [](double) { return true; };
        Index may[together], any = 0;
        for (Index s = 0; s < count; ++s) any += may[s] = may_fall(determinant_of<d>(now, before, s), horizon);
        for (Index s = 0; any && s < count; ++s) {
            if (!may[s]) continue;
            const Cubic p = determinant_of<d>(now, before, s);
            found[s] = p[0] > 0.0 ? std::min(found[s], first_root(p, std::min(horizon, found[s]), always)) : 0.0;
        }
    });
}

/// Steps (m,) before which no corner of the cells inverts; rotations do not count.
///
/// With J = V E⁻¹ and its symmetric part S, (1 + s J) x = 0 gives s x·S x = −x·x. So 1/s is at most minus the least
/// eigenvalue of S, which is at least tr S / d − √(1 − 1/d) |D| with D = S − tr S / d. In the plane both are equal; in
/// space Newton's steps for the characteristic polynomial x³ − |D|²/2 x − det D come closer and never pass a root.
template <class Type>
void safe_steps(Matrix<const double> points, Matrix<const double> start, Matrix<const Node> nodes, double* steps) {
    std::fill_n(steps, nodes.shape(0), never);
    for_corners<Type>(points, start, nodes, [&](const auto& now, const auto& before, Index count, Index first) {
        constexpr int d = Type::dimension;
        for (Index s = 0; s < count; ++s) {
            const auto edge = [&](int i, int k) { return now.entry[i % d][k % d][s]; };
            const auto cofactor = [&](int i, int k) {
                if constexpr (d == 1) return 1.0;
                else if constexpr (d == 2) return i == k ? edge(i + 1, k + 1) : -edge(i + 1, k + 1);
                else return edge(i + 1, k + 1) * edge(i + 2, k + 2) - edge(i + 1, k + 2) * edge(i + 2, k + 1);
            };
            double det = 0.0, j[d][d] = {}, part[d][d], trace = 0.0, square = 0.0;
            for (int k = 0; k < d; ++k) det += edge(0, k) * cofactor(0, k);
            const double unit = 1.0 / (det > 0.0 ? det : 1.0);  // avoids a division by zero, which ends OpenFOAM
            for (int a = 0; a < d; ++a)
                for (int b = 0; b < d; ++b)
                    for (int k = 0; k < d; ++k)
                        j[a][b] += (now.entry[a][k][s] - before.entry[a][k][s]) * cofactor(b, k) * unit;
            for (int a = 0; a < d; ++a) trace += j[a][a] / d;
            for (int a = 0; a < d; ++a)
                for (int b = 0; b < d; ++b) {
                    part[a][b] = 0.5 * (j[a][b] + j[b][a]) - (a == b ? trace : 0.0);
                    square += part[a][b] * part[a][b];
                }
            double fastest = std::sqrt((1.0 - 1.0 / d) * square);  // −x
            if constexpr (d == 3) {
                double product = 0.0;
                for (int k = 0; k < d; ++k) {
                    const int l = (k + 1) % d, m = (k + 2) % d;
                    product += part[0][k] * (part[1][l] * part[2][m] - part[1][m] * part[2][l]);
                }
                for (int step = 0; step < 2; ++step) {
                    const double x = fastest, slope = 3.0 * x * x - 0.5 * square;
                    fastest -= (x * x * x - 0.5 * square * x + product) / (slope > 0.0 ? slope : 1.0);
                }
            }
            fastest -= trace;
            double& least = steps[first + s];
            least = det > 0.0 ? std::min(least, fastest > 0.0 ? 1.0 / fastest : never) : 0.0;
        }
    });
}

/// Steps to inversion of the cells of several blocks with consecutive numbers.
class Inversions {
  public:
    Inversions(Matrix<const double> points, Matrix<const double> before, const std::vector<Matrix<const Node>>& blocks)
        : points_(points), before_(before) {
        for (const auto& nodes : blocks) {
            with_cell_type(points.shape(1), nodes.shape(1), [&]<class Type>(Type) {
                blocks_.push_back({nodes, size_, until_inverted<Type>, safe_steps<Type>});
            });
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
                block.until(points_, before_, block.nodes.rows(row, row + count), limit, steps);
                lowest.add(steps, begin, count, limit);
                least = std::min(least, *std::min_element(steps, steps + count));
            });
        }
        return least;
    }

    /// Steps of cells with ascending numbers, up to the limit.
    std::vector<double> of(const std::vector<Index>& numbers, double limit) const {
        return of_each(numbers, [&](const Block& block, Matrix<const Node> rows, double* steps) {
            block.until(points_, before_, rows, limit, steps);
        });
    }

    /// Steps of cells with ascending numbers before which they do not invert.
    std::vector<double> safe(const std::vector<Index>& numbers) const {
        return of_each(numbers, [&](const Block& block, Matrix<const Node> rows, double* steps) {
            block.safe(points_, before_, rows, steps);
        });
    }

  private:
    struct Block {
        Matrix<const Node> nodes;
        Index first;
        void (*until)(Matrix<const double>, Matrix<const double>, Matrix<const Node>, double, double*);
        void (*safe)(Matrix<const double>, Matrix<const double>, Matrix<const Node>, double*);
    };

    template <class F>
    std::vector<double> of_each(const std::vector<Index>& numbers, F&& f) const {
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
                f(block, Matrix<const Node>(nodes.data(), {begin - from, block.nodes.shape(1)}), steps.data() + from);
            }
        });
        return steps;
    }

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
    lower_limit(cells.of(some, horizon));
    const std::vector<double> steps = cells.safe(samples);
    std::vector<double> least(groups, never), found(groups, never);  // safe steps of the samples; steps of all cells
    for (std::size_t k = 0; k < samples.size(); ++k) {
        const Index g = samples[k] / width;
        least[g] = std::min(least[g], steps[k]);
        if (g > 0 && samples[k] == g * width) least[g - 1] = std::min(least[g - 1], steps[k]);
    }

    // a step is rough if most cells at the first samples have other safe steps
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
        std::vector<double> its = cells.safe(own);
        rough += select(its, static_cast<Index>(its.size()) / 2) > unlike * least[order[k]];
        its = cells.of(own, limit);
        roots.insert(roots.end(), its.begin(), its.end());
    }
    lower_limit(roots);

    double reach = width < least_group || 2 * rough > early ? unlike : least_reach;
    std::vector<char> seen(groups);
    Lowest first(count);
    for (Index most = 32; reach < unlike; most *= 4) {
        std::vector<Index> todo;
        for (Index g = 0; g < groups; ++g)
            if (!seen[g] && least[g] <= reach * limit) todo.push_back(g);
        if (todo.empty()) return first;  // it has all samples up to the limit
        if (most < static_cast<Index>(todo.size())) {  // the earliest ones lower the limit, and fewer others are left
            std::nth_element(todo.begin(), todo.begin() + most, todo.end(), by_least);
            todo.resize(most);
        }
        first.add(looked_at(cells, width, todo, limit, count, found));
        for (Index g : todo) seen[g] = 1;
        lower_limit(first.in_order().first);
        for (Index g = 0; g < groups; ++g)
            if (found[g] <= limit && found[g] < least[g])
                reach = std::max(reach, least[g] < unlike * found[g] ? margin * least[g] / found[g] : unlike);
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
