#include "quality/summaries.h"

#include <algorithm>
#include <bit>
#include <functional>
#include <limits>
#include <memory>
#include <numeric>
#include <optional>

#include "parallel.h"
#include "quality/order_statistics.h"

namespace mesh_motion {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr Index looked_at_first = 1 << 13;  // number of sampled cells whose lowest values give the limit for the others

/// The values of cells that were judged together.
struct Judged {
    std::vector<double> size, skew, relative, values;
    std::unique_ptr<bool[]> inverted;

    Judged(Index count, Metric ranked)
        : size(count), skew(count), relative(ranked == Metric::relative_size_skew ? count : 0), values(count),
          inverted(new bool[count]) {}

    /// Memory for the values of the cells from `first` on.
    Judgement from(Index first) {
        double* const shapes = relative.empty() ? nullptr : relative.data();
        return Judgement{size.data(), skew.data(), inverted.get(), shapes}.from(first);
    }

    /// Computes the values of a metric.
    void fill(Metric metric) {
        metric_of(metric, static_cast<Index>(size.size()), size.data(), skew.data(), relative.data(), values.data());
    }
};

/// Judges cells with ascending numbers, on all threads.
Judged judged(const Cells& cells, const std::vector<Index>& numbers, Metric ranked) {
    const Index n = static_cast<Index>(numbers.size());
    Judged found(n, ranked);
    for_ranges(n, 8 * chunk, [&](Index first, Index last) {
        cells.judge_chosen({numbers.data() + first, {last - first}}, found.from(first));
    });
    return found;
}

/// An upper limit for the `count` lowest of m values; the sample is reordered.
double limit_of(std::vector<double>& sample, Index count, Index m) {
    if (count > static_cast<Index>(sample.size())) return infinity;
    return count < 1 || m < 1 ? -infinity : select(sample, count - 1);
}

Metric checked(Index metric, const Cells& cells, double corner_limit = 0.0) {
    require(metric >= 0 && metric <= static_cast<Index>(Metric::relative_size_skew), "metric: expected 0 to 5");
    const auto known = static_cast<Metric>(metric);
    require((known != Metric::relative_size_skew && !(corner_limit > 0.0)) || cells.has_rest(),
            "rest: expected the skews and points at rest");
    return known;
}

/// The metrics of a report: size, skew, size-skew and, if it is another one, the metric that ranks.
std::vector<Metric> reported(Metric ranked) {
    std::vector<Metric> metrics{Metric::size, Metric::skew, Metric::size_skew};
    if (ranked > Metric::size_skew) metrics.push_back(ranked);
    return metrics;
}

/// The cells whose worst corner has a lower quality than a limit; none if the limit is 0.
struct Distorted {
    double limit;
    std::vector<Index> numbers;

    /// Adds those of the n cells from `first` on.
    void add(const double* corner, Index first, Index n) {
        bool any = false;
        for (Index s = 0; s < n; ++s) any |= corner[s] < limit;
        for (Index s = 0; any && s < n; ++s)
            if (corner[s] < limit) numbers.push_back(first + s);
    }
};

/// The cells of all tasks.
Owned<Index, 1> together(const std::vector<Distorted>& tasks) {
    std::vector<Index> all;
    for (const Distorted& task : tasks) all.insert(all.end(), task.numbers.begin(), task.numbers.end());
    return owned(std::move(all));
}

/// Calls f(k, values) for the reported metrics of the cells first … first + n − 1, at most a chunk; returns the number of
/// inverted cells.
template <class F>
Index for_metrics(const Cells& cells, const std::vector<Metric>& metrics, Index first, Index n, Distorted& distorted,
                  F&& f) {
    alignas(64) double size[chunk], skew[chunk], relative[chunk], corner[chunk], other[chunk];
    bool inverted[chunk];
    const bool is_relative = metrics.back() == Metric::relative_size_skew, compares = distorted.limit > 0.0;
    cells.judge(first, first + n,
                {size, skew, inverted, is_relative ? relative : nullptr, compares ? corner : nullptr});
    if (compares) distorted.add(corner, first, n);
    for (Index k = 0; k < static_cast<Index>(metrics.size()); ++k) {
        if (k > 1) metric_of(metrics[k], n, size, skew, relative, other);
        f(k, k == 0 ? size : k == 1 ? skew : other);
    }
    return std::count(inverted, inverted + n, true);
}

/// Bins of [−1, 1], each divided into equal parts: the bins of count_in_bins, for vectors of any width.
struct Bins {
    /// Counts go to these sets in turn: counts of equal values, which are frequent, then need not wait for each other.
    static constexpr Index sets = 4;
    Index bins;
    std::vector<std::uint32_t> counts = std::vector<std::uint32_t>(sets * bins);
    std::array<double, chunk> most;

    explicit Bins(Index bins) : bins(bins) { most.fill(-infinity); }

    /// Adds the next n values, at most a chunk, and writes their places.
    void add(const double* __restrict values, Index n, std::uint32_t* __restrict places) {
        const double count = static_cast<double>(bins), last = count - 1.0;
        const double scale = 0.5 * count, width = 1.0 / scale, finer = scale * count;
        const auto inside = [last](double place) {
            place = place > 0.0 ? place : 0.0;
            return static_cast<std::int32_t>(place < last ? place : last);
        };
        std::int32_t bin[chunk];
        for (Index s = 0; s < n; ++s) {
            const double value = values[s];
            bin[s] = inside((value + 1.0) * scale);
            const double low = static_cast<double>(bin[s]) * width - 1.0;
            places[s] = static_cast<std::uint32_t>(bin[s] * static_cast<std::int32_t>(count) +
                                                   inside((value - low) * finer));
        }
        for (Index s = 0; s < n; ++s) most[s] = values[s] > most[s] ? values[s] : most[s];
        for (Index s = 0; s < n; ++s) ++counts[bin[s] * sets + s % sets];
    }
};

/// Refuses a number of bins if the parts of the bins have no exact limits, or are too many to be numbered.
void check_bins(Index bins) {
    require(0 < bins && bins < 1 << 15 && (bins & (bins - 1)) == 0, "bins: expected a power of 2 below 32768");
}

}  // namespace

std::tuple<Owned<double, 1>, Owned<Index, 1>, Index, Owned<Index, 1>> lowest_cells(
    Matrix<const double> points, const Blocks& blocks, Vector<const double> reference, AtRest rest, Index metric,
    Index count, double corner_limit) {
    const Cells cells(points, blocks, reference, rest);
    const Metric ranked = checked(metric, cells, corner_limit);
    const Index m = cells.size();
    const auto first_ones = sample_of(m, std::min(m, looked_at_first));
    Judged sample = judged(cells, first_ones, ranked);
    sample.fill(ranked);
    const double limit = limit_of(sample.values, count, m);

    const Index tasks = (m + judged_at_once - 1) / judged_at_once;
    std::vector<Lowest> lowest(tasks, Lowest(count));
    std::vector<Index> inversions(tasks);
    std::vector<Distorted> distorted(tasks, Distorted{corner_limit, {}});
    for_ranges(m, judged_at_once, [&](Index begin, Index end) {
        const Index task = begin / judged_at_once;
        std::vector<Index> near;
        for (Index first = begin; first < end; first += chunk) {
            Index marks[chunk];
            const Index last = std::min(end, first + chunk);
            if (cells.mark_near(first, last, ranked, limit, corner_limit, marks))
                for (Index e = first; e < last; ++e)
                    if (marks[e - first]) near.push_back(e);
        }
        Judged found(static_cast<Index>(near.size()), ranked);
        std::vector<double> corner(corner_limit > 0.0 ? near.size() : 0);
        Judgement places = found.from(0);
        places.corner = corner.empty() ? nullptr : corner.data();
        cells.judge_chosen(view_of(near), places);
        found.fill(ranked);
        for (std::size_t k = 0; k < near.size(); ++k)
            if (found.values[k] <= limit) lowest[task].add(found.values[k], near[k]);
        for (std::size_t k = 0; k < corner.size(); ++k)
            if (corner[k] < corner_limit) distorted[task].numbers.push_back(near[k]);
        lowest[task].trim();
        inversions[task] = std::count(found.inverted.get(), found.inverted.get() + near.size(), true);
    });
    Lowest all(count);
    for (const Lowest& part : lowest) all.add(part);
    auto [values, numbers] = all.in_order();
    return {owned(std::move(values)), owned(std::move(numbers)),
            std::accumulate(inversions.begin(), inversions.end(), Index{0}), together(distorted)};
}

std::tuple<Owned<double, 2>, Owned<Index, 1>, Index, Owned<Index, 1>> judged_cells(
    Matrix<const double> points, const Blocks& blocks, Vector<const double> reference, AtRest rest, Index metric,
    Index count, double corner_limit) {
    const Cells cells(points, blocks, reference, rest);
    const Metric ranked = checked(metric, cells, corner_limit);
    const Index m = cells.size();
    require(m > 0, "blocks: expected at least one cell");
    const auto metrics = reported(ranked);
    const Index kinds = static_cast<Index>(metrics.size()), place = std::min<Index>(metric, 3);

    // the limits that a sample gives for all values
    const auto numbers = sample_of(m, sample_size(m));
    Judged sample = judged(cells, numbers, ranked);
    std::vector<Brackets> brackets(numbers.empty() ? 0 : kinds);
    double limit = infinity;
    std::vector<std::vector<double>> values(kinds);
    for (Index k = 0; k < kinds && !numbers.empty(); ++k) {
        sample.fill(metrics[k]);
        values[k] = sample.values;
    }
    for_blocks(static_cast<Index>(brackets.size()), [&](Index k) {
        brackets[k] = brackets_of(values[k]);
        if (k == place) limit = limit_of(values[k], count, m);
    });

    // one pass over all cells; kept (kinds, m) gets the values, if requested
    constexpr Index task_size = 4 * judged_at_once;
    const Index tasks = (m + task_size - 1) / task_size;
    std::vector<std::vector<Tally>> tallies(kinds, std::vector<Tally>(tasks));
    std::vector<Lowest> lowest(tasks, Lowest(count));
    std::vector<Index> inversions(tasks);
    std::vector<Distorted> distorted(tasks, Distorted{corner_limit, {}});
    const auto pass = [&](std::vector<std::vector<double>>* kept, bool tally) {
        for_ranges(m, task_size, [&](Index begin, Index end) {
            const Index task = begin / task_size;
            Index turned = 0;
            Distorted here{tally ? corner_limit : 0.0, {}};
            for (Index first = begin; first < end; first += chunk) {
                const Index n = std::min(chunk, end - first);
                turned += for_metrics(cells, metrics, first, n, here, [&](Index k, const double* own) {
                    if (kept) std::copy_n(own, n, (*kept)[k].data() + first);
                    if (!tally) return;
                    tallies[k][task].add(own, n, brackets.empty() ? nullptr : &brackets[k]);
                    if (k == place) lowest[task].add(own, first, n, limit);
                });
            }
            if (!tally) return;
            lowest[task].trim();
            inversions[task] = turned;
            distorted[task] = std::move(here);
        });
    };
    std::vector<std::vector<double>> kept(kinds);
    const auto keep = [&] {
        for (auto& one : kept) one.resize(m);
    };
    if (brackets.empty()) keep();
    pass(brackets.empty() ? &kept : nullptr, true);

    std::vector<Distribution> distributions(kinds);
    std::vector<char> proven(kinds * percentiles);
    for_blocks(kinds * percentiles, [&](Index both) {
        const Index k = both / percentiles, p = both % percentiles;
        proven[both] = !brackets.empty() && percentile_of(tallies[k], m, p, brackets[k][p], distributions[k][2 + p]);
    });
    std::vector<double> found;
    for (Index k = 0; k < kinds; ++k) {
        Distribution& one = distributions[k];
        std::tie(one[0], one[1]) = minimum_and_mean(tallies[k], m);
        if (!std::all_of(&proven[k * percentiles], &proven[k * percentiles] + percentiles, std::identity{})) {
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
        found.insert(found.end(), one.begin(), one.end());
    }
    Lowest all(count);
    for (const Lowest& part : lowest) all.add(part);
    return {Owned<double, 2>{std::move(found), {kinds, 2 + percentiles}}, owned(all.in_order().second),
            std::accumulate(inversions.begin(), inversions.end(), Index{0}), together(distorted)};
}

Owned<double, 2> values_of_cells(Matrix<const double> points, const Blocks& blocks, Vector<const double> reference,
                                 AtRest rest, Index metric, Vector<const Index> numbers) {
    const Cells cells(points, blocks, reference, rest);
    const Metric columns[] = {checked(metric, cells), Metric::size, Metric::skew, Metric::size_skew};
    require_below(numbers, cells.size(), "numbers: expected numbers of cells");
    const Index n = numbers.size();
    std::vector<Index> order(n), ascending(n);
    std::iota(order.begin(), order.end(), Index{0});
    std::sort(order.begin(), order.end(), [&](Index a, Index b) { return numbers[a] < numbers[b]; });
    for (Index s = 0; s < n; ++s) ascending[s] = numbers[order[s]];
    Judged found = judged(cells, ascending, columns[0]);
    std::vector<double> rows(4 * n);
    for (Index k = 0; k < 4; ++k) {
        found.fill(columns[k]);
        for (Index s = 0; s < n; ++s) rows[4 * order[s] + k] = found.values[s];
    }
    return {std::move(rows), {n, 4}};
}

Owned<double, 2> values_along(Matrix<const double> points, Matrix<const double> before, const Blocks& blocks,
                              Vector<const double> reference, AtRest rest, Index metric, Vector<const Index> numbers,
                              Vector<const double> places) {
    const Cells cells(points, blocks, reference, rest);
    const Metric known = checked(metric, cells);
    require(before.shape() == points.shape(), "before: expected the shape of points");
    require_below(numbers, cells.size(), "numbers: expected numbers of cells");
    require(std::is_sorted(numbers.begin(), numbers.end()), "numbers: expected ascending numbers");
    std::vector<std::vector<Node>> rows;  // the mesh of these cells alone
    std::vector<Node> nodes;
    std::vector<double> sizes, skews;
    const Index* number = numbers.begin();
    for (Index first = 0; const auto& block : blocks) {
        auto& own = rows.emplace_back();
        for (; number < numbers.end() && *number < first + block.shape(0); ++number) {
            const auto row = block[*number - first];
            own.insert(own.end(), row.begin(), row.end());
            sizes.push_back(reference[*number]);
            if (cells.has_rest()) skews.push_back(rest.skews[*number]);
        }
        nodes.insert(nodes.end(), own.begin(), own.end());
        first += block.shape(0);
    }
    require_below(Vector<const Node>(view_of(nodes)), points.shape(0), "nodes: expected numbers of points");
    std::sort(nodes.begin(), nodes.end());
    nodes.erase(std::unique(nodes.begin(), nodes.end()), nodes.end());
    Blocks chosen;
    for (auto& own : rows) {
        for (Node& node : own)
            node = static_cast<Node>(std::lower_bound(nodes.begin(), nodes.end(), node) - nodes.begin());
        const Index width = blocks[chosen.size()].shape(1);
        chosen.push_back({own.data(), {static_cast<Index>(own.size()) / width, width}});
    }
    const Index n = numbers.size(), d = points.shape(1), used = static_cast<Index>(nodes.size());
    const auto of_nodes = [&](Matrix<const double> all) {
        std::vector<double> own;
        for (Node node : nodes) own.insert(own.end(), all[node].begin(), all[node].end());
        return own;
    };
    const std::vector<double> now = of_nodes(points), then = of_nodes(before);
    const std::vector<double> at_rest = cells.has_rest() ? of_nodes(rest.points) : std::vector<double>{};
    const AtRest own_rest{view_of(skews), {at_rest.data(), {cells.has_rest() ? used : 0, d}}};
    std::vector<double> there(now), values;
    const Cells own({there.data(), {used, d}}, chosen, view_of(sizes), own_rest);
    for (double place : places) {
        for (std::size_t i = 0; i < there.size(); ++i) there[i] = now[i] + place * (now[i] - then[i]);
        Judged found(n, known);
        own.judge(0, n, found.from(0));
        found.fill(known);
        values.insert(values.end(), found.values.begin(), found.values.end());
    }
    return {std::move(values), {places.size(), n}};
}

std::tuple<Owned<double, 2>, Owned<Index, 2>, Owned<Index, 1>, Index> counted_cells(
    Matrix<const double> points, const Blocks& blocks, Vector<const double> reference, AtRest rest,
    Index metric, Index count, Index bins, Matrix<std::uint32_t> places) {
    const Cells cells(points, blocks, reference, rest);
    const Metric ranked = checked(metric, cells);
    const auto metrics = reported(ranked);
    const Index m = cells.size(), kinds = static_cast<Index>(metrics.size()), place = std::min<Index>(metric, 3);
    check_bins(bins);
    require(places.shape(0) == kinds && places.shape(1) == m, "places: expected one for each metric and cell");
    const auto numbers = sample_of(m, std::min(m, looked_at_first));
    Judged sample = judged(cells, numbers, ranked);
    sample.fill(ranked);
    const double limit = limit_of(sample.values, count, m);

    constexpr Index task_size = 8 * judged_at_once;
    const Index tasks = (m + task_size - 1) / task_size;
    std::vector<std::vector<Tally>> tallies(kinds, std::vector<Tally>(tasks));
    std::vector<Lowest> lowest(tasks, Lowest(count));
    std::vector<Index> inversions(tasks);
    Owned<Index, 2> counts{std::vector<Index>(kinds * bins), {kinds, bins}};
    std::vector<std::vector<double>> most(kinds, std::vector<double>(tasks));
    for_ranges(m, task_size, [&](Index begin, Index end) {
        const Index task = begin / task_size;
        std::vector<Bins> here(kinds, Bins(bins));
        Distorted none{0.0, {}};
        Index turned = 0;
        for (Index first = begin; first < end; first += chunk) {
            const Index n = std::min(chunk, end - first);
            turned += for_metrics(cells, metrics, first, n, none, [&](Index k, const double* own) {
                tallies[k][task].add(own, n, nullptr);
                here[k].add(own, n, places[k].data() + first);
                if (k == place) lowest[task].add(own, first, n, limit);
            });
        }
        lowest[task].trim();
        inversions[task] = turned;
        for (Index k = 0; k < kinds; ++k) {
            most[k][task] = *std::max_element(here[k].most.begin(), here[k].most.end());
            for (std::size_t c = 0; c < here[k].counts.size(); ++c)
                if (here[k].counts[c])
                    __atomic_fetch_add(&counts.values[k * bins + static_cast<Index>(c) / Bins::sets], here[k].counts[c],
                                       __ATOMIC_RELAXED);
        }
    });

    std::vector<double> found;
    for (Index k = 0; k < kinds; ++k) {
        double total = 0.0, least = infinity;
        for (const Tally& tally : tallies[k]) {
            total += tally.sum();
            least = std::min(least, *std::min_element(tally.least.begin(), tally.least.end()));
        }
        found.insert(found.end(), {total, least, std::accumulate(most[k].begin(), most[k].end(), -infinity,
                                                                 [](double a, double b) { return std::max(a, b); })});
    }
    Lowest all(count);
    for (const Lowest& part : lowest) all.add(part);
    return {Owned<double, 2>{std::move(found), {kinds, 3}}, std::move(counts), owned(all.in_order().second),
            std::accumulate(inversions.begin(), inversions.end(), Index{0})};
}

Owned<Index, 2> counts_in_parts(Vector<const std::uint32_t> places, Vector<const std::uint32_t> wanted, Index bins) {
    check_bins(bins);
    require_below(wanted, bins, "wanted: expected numbers of bins");
    require_below(places, bins * bins, "places: expected parts of bins");
    const Index rows = wanted.size(), shift = std::countr_zero(static_cast<std::uint64_t>(bins));
    std::vector<std::int32_t> row(bins, -1);
    for (Index w = 0; w < rows; ++w) row[wanted[w]] = static_cast<std::int32_t>(w);
    Owned<Index, 2> counts{std::vector<Index>(rows * bins), {rows, bins}};
    for (Index first = 0; first < places.size(); first += chunk) {
        const std::uint32_t* at = places.data() + first;
        const Index n = std::min(chunk, places.size() - first);
        std::uint32_t found[chunk];
        Index number = 0;
        for (Index s = 0; s < n; ++s) {
            found[number] = at[s];
            number += row[at[s] >> shift] >= 0;
        }
        for (Index s = 0; s < number; ++s)
            ++counts.values[row[found[s] >> shift] * bins + (found[s] & static_cast<std::uint32_t>(bins - 1))];
    }
    return counts;
}

Owned<double, 1> values_at(Matrix<const double> points, const Blocks& blocks, Vector<const double> reference,
                           AtRest rest, Index metric, Vector<const std::uint32_t> places,
                           Vector<const std::uint32_t> wanted) {
    const Cells cells(points, blocks, reference, rest);
    const Metric asked = checked(metric, cells);
    require(places.size() == cells.size(), "places: expected one for each cell");
    std::vector<std::uint32_t> sorted(wanted.begin(), wanted.end());
    std::sort(sorted.begin(), sorted.end());
    const std::uint32_t low = sorted.empty() ? 0 : sorted.front(), span = sorted.empty() ? 0 : sorted.back() - low;
    std::vector<Index> numbers;
    for (Index first = 0; first < places.size() && !sorted.empty(); first += chunk) {
        const std::uint32_t* at = places.data() + first;
        const Index n = std::min(chunk, places.size() - first);
        std::uint32_t any = 0;
        if (sorted.size() <= 16) {
            for (std::uint32_t place : sorted)
                for (Index s = 0; s < n; ++s) any |= at[s] == place;
        } else {  // all wanted parts are in one bin: most places are below or above all of them
            for (Index s = 0; s < n; ++s) any |= at[s] - low <= span;
        }
        for (Index s = 0; any && s < n; ++s)
            if (at[s] - low <= span && std::binary_search(sorted.begin(), sorted.end(), at[s]))
                numbers.push_back(first + s);
    }
    Judged all = judged(cells, numbers, asked);
    all.fill(asked);
    return owned(std::move(all.values));
}

}  // namespace mesh_motion
