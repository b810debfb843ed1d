#include "quality/summaries.h"

#include <limits>
#include <memory>
#include <numeric>
#include <optional>

#include "parallel.h"
#include "quality/order_statistics.h"

namespace mesh_motion {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr Index looked_at_first = 1 << 13;  // cells whose lowest values are the limit of the others

/// Values of cells that were judged together.
struct Judged {
    std::vector<double> size, skew, values;
    std::unique_ptr<bool[]> inverted;

    explicit Judged(Index count) : size(count), skew(count), values(count), inverted(new bool[count]) {}
};

/// Judges cells with ascending numbers, on all threads.
Judged judged(const Cells& cells, const std::vector<Index>& numbers) {
    const Index n = static_cast<Index>(numbers.size());
    Judged found(n);
    for_ranges(n, 8 * chunk, [&](Index first, Index last) {
        cells.judge_chosen({numbers.data() + first, {last - first}}, &found.size[first], &found.skew[first],
                           &found.inverted[first]);
    });
    return found;
}

/// Values of a metric of judged cells with ascending numbers.
void fill(Metric metric, const Cells& cells, const std::vector<Index>& numbers, Judged& found) {
    std::vector<double> rest;
    if (metric == Metric::relative_size_skew)
        for (Index number : numbers) rest.push_back(cells.rest()[number]);
    metric_of(metric, static_cast<Index>(numbers.size()), found.size.data(), found.skew.data(), rest.data(),
              found.values.data());
}

/// A number that the `count` lowest of m values are not above; the order of the sample is lost.
double limit_of(std::vector<double>& sample, Index count, Index m) {
    if (count > static_cast<Index>(sample.size())) return infinity;
    return count < 1 || m < 1 ? -infinity : select(sample, count - 1);
}

Metric checked(Index metric, const Cells& cells) {
    require(metric >= 0 && metric <= static_cast<Index>(Metric::relative_size_skew), "metric: expected 0 to 5");
    const auto known = static_cast<Metric>(metric);
    require(known != Metric::relative_size_skew || cells.has_rest(), "rest: expected the skews at rest");
    return known;
}

}  // namespace

std::tuple<Owned<double, 1>, Owned<Index, 1>, Index> lowest_cells(Matrix<const double> points, const Blocks& blocks,
                                                                  Vector<const double> reference,
                                                                  Vector<const double> rest, Index metric,
                                                                  Index count) {
    const Cells cells(points, blocks, reference, rest);
    const Metric ranked = checked(metric, cells);
    const Index m = cells.size();
    const auto first_ones = sample_of(m, std::min(m, looked_at_first));
    Judged sample = judged(cells, first_ones);
    fill(ranked, cells, first_ones, sample);
    const double limit = limit_of(sample.values, count, m);

    const Index tasks = (m + judged_at_once - 1) / judged_at_once;
    std::vector<Lowest> lowest(tasks, Lowest(count));
    std::vector<Index> inversions(tasks);
    for_ranges(m, judged_at_once, [&](Index begin, Index end) {
        const Index task = begin / judged_at_once;
        std::vector<Index> near;
        for (Index first = begin; first < end; first += chunk) {
            Index marks[chunk];
            const Index last = std::min(end, first + chunk);
            if (cells.mark_near(first, last, ranked, limit, marks))
                for (Index e = first; e < last; ++e)
                    if (marks[e - first]) near.push_back(e);
        }
        Judged found(static_cast<Index>(near.size()));
        cells.judge_chosen(view_of(near), found.size.data(), found.skew.data(), found.inverted.get());
        fill(ranked, cells, near, found);
        for (std::size_t k = 0; k < near.size(); ++k) {
            inversions[task] += found.inverted[k];
            if (found.values[k] <= limit) lowest[task].add(found.values[k], near[k]);
        }
        lowest[task].trim();
    });
    Lowest all(count);
    for (const Lowest& part : lowest) all.add(part);
    auto [values, numbers] = all.in_order();
    return {owned(std::move(values)), owned(std::move(numbers)),
            std::accumulate(inversions.begin(), inversions.end(), Index{0})};
}

std::tuple<Owned<double, 2>, Owned<Index, 1>, Index> judged_cells(Matrix<const double> points, const Blocks& blocks,
                                                                  Vector<const double> reference,
                                                                  Vector<const double> rest, Index metric,
                                                                  Index count) {
    const Cells cells(points, blocks, reference, rest);
    const Metric ranked = checked(metric, cells);
    const Index m = cells.size();
    require(m > 0, "blocks: expected at least one cell");
    std::vector<Metric> metrics{Metric::size, Metric::skew, Metric::size_skew};
    if (metric > 2) metrics.push_back(ranked);
    const Index kinds = static_cast<Index>(metrics.size()), place = std::min<Index>(metric, 3);

    // what a sample says of all
    const auto numbers = sample_of(m, sample_size(m));
    Judged sample = judged(cells, numbers);
    std::vector<Brackets> brackets(numbers.empty() ? 0 : kinds);
    double limit = infinity;
    std::vector<std::vector<double>> values(kinds);
    for (Index k = 0; k < kinds && !numbers.empty(); ++k) {
        fill(metrics[k], cells, numbers, sample);
        values[k] = sample.values;
    }
    for_blocks(static_cast<Index>(brackets.size()), [&](Index k) {
        brackets[k] = brackets_of(values[k]);
        if (k == place) limit = limit_of(values[k], count, m);
    });

    // one pass over all cells; kept (kinds, m) takes the values where they are asked for
    constexpr Index task_size = 4 * judged_at_once;
    const Index tasks = (m + task_size - 1) / task_size;
    std::vector<std::vector<Tally>> tallies(kinds, std::vector<Tally>(tasks));
    std::vector<Lowest> lowest(tasks, Lowest(count));
    std::vector<Index> inversions(tasks);
    const auto pass = [&](std::vector<std::vector<double>>* kept, bool tally) {
        for_ranges(m, task_size, [&](Index begin, Index end) {
            const Index task = begin / task_size;
            for (Index first = begin; first < end; first += chunk) {
                alignas(64) double size[chunk], skew[chunk], other[chunk];
                bool inverted[chunk];
                const Index n = std::min(chunk, end - first);
                cells.judge(first, first + n, size, skew, inverted);
                for (Index k = 0; k < kinds; ++k) {
                    const double* own = k == 0 ? size : k == 1 ? skew : other;
                    if (k > 1)
                        metric_of(metrics[k], n, size, skew,
                                  metrics[k] == Metric::relative_size_skew ? cells.rest() + first : nullptr, other);
                    if (kept) std::copy_n(own, n, (*kept)[k].data() + first);
                    if (!tally) continue;
                    tallies[k][task].add(own, n, brackets.empty() ? nullptr : &brackets[k]);
                    if (k == place) lowest[task].add(own, first, n, limit);
                }
                if (tally)
                    for (Index s = 0; s < n; ++s) inversions[task] += inverted[s];
            }
            lowest[task].trim();
        });
    };
    std::vector<std::vector<double>> kept(kinds);
    const auto keep = [&] {
        for (auto& one : kept) one.resize(m);
    };
    if (brackets.empty()) keep();
    pass(brackets.empty() ? &kept : nullptr, true);

    std::vector<double> found(kinds * (2 + percentiles));
    for (Index k = 0; k < kinds; ++k) {
        Distribution one;
        if (!distribution_of(tallies[k], m, brackets.empty() ? nullptr : &brackets[k], one)) {
            if (kept[k].empty()) {
                keep();
                pass(&kept, false);
            }
            const auto ranks = percentile_ranks(m);
            for (int p = 0; p < percentiles; ++p) {
                auto left = kept[k];
                one[2 + p] = select(left, ranks[p]);
            }
        }
        std::copy(one.begin(), one.end(), found.begin() + k * (2 + percentiles));
    }
    Lowest all(count);
    for (const Lowest& part : lowest) all.add(part);
    return {Owned<double, 2>{std::move(found), {kinds, 2 + percentiles}}, owned(all.in_order().second),
            std::accumulate(inversions.begin(), inversions.end(), Index{0})};
}

}  // namespace mesh_motion
