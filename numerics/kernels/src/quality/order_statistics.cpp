#include "quality/order_statistics.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <numeric>

#include "parallel.h"

namespace mesh_motion {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr std::array<double, percentiles> parts{0.01, 0.05, 0.5};
constexpr double deviations = 4.0;  // of a rank in a sample: larger deviations have a probability of one in 16 000
constexpr Index few = 1 << 14;      // up to this number, all values are kept
constexpr Index block = 1 << 15;    // values in one task, a multiple of the lanes
constexpr Index piece = 128;        // values that are compared together

using Register [[gnu::vector_size(register_lanes * sizeof(double))]] = double;
using Counts [[gnu::vector_size(register_lanes * sizeof(Index))]] = Index;

/// Bin of a value; never decreases with the value, in spite of rounding. −∞ goes to the first bin.
inline Index bin_of(double value, double low, double scale, Index bins) {
    const double place = (value - low) * scale;
    if (!(place > 0.0)) return 0;
    return place >= static_cast<double>(bins) ? bins - 1 : static_cast<Index>(place);
}

/// A pseudo-random number (splitmix64), the same on every machine.
std::uint64_t scrambled(std::uint64_t x) {
    x = (x + 0x9e3779b97f4a7c15u) * 0xbf58476d1ce4e5b9u;
    x = (x ^ x >> 27) * 0x94d049bb133111ebu;
    return x ^ x >> 31;
}

}  // namespace

std::array<Index, percentiles> percentile_ranks(Index m) {
    return {(m - 1) / 100, 5 * (m - 1) / 100, 50 * (m - 1) / 100};
}

double select(std::vector<double>& values, Index rank) {
    constexpr Index bins = 1024;
    std::erase_if(values, [](double value) { return value != value; });  // NaN has no rank
    if (rank >= static_cast<Index>(values.size())) return std::numeric_limits<double>::quiet_NaN();
    while (static_cast<Index>(values.size()) > 4 * bins) {  // counting equal bins is faster than comparisons
        double low = infinity, high = -infinity;
        for (double value : values) low = value < low ? value : low, high = value > high ? value : high;
        const double scale = bins / (high - low);
        if (!(scale < infinity && scale > 0.0)) break;  // all values are equal, or some are not finite
        std::array<Index, bins> counts{};
        for (double value : values) ++counts[bin_of(value, low, scale, bins)];
        Index wanted = 0;
        for (; rank >= counts[wanted]; ++wanted) rank -= counts[wanted];
        if (counts[wanted] > static_cast<Index>(values.size()) / 2) {
            for (Index bin = 0; bin < wanted; ++bin) rank += counts[bin];
            break;
        }
        std::erase_if(values, [&](double value) { return bin_of(value, low, scale, bins) != wanted; });
    }
    std::nth_element(values.begin(), values.begin() + rank, values.end());
    return values[rank];
}

std::vector<Index> sample_of(Index m, Index count) {
    std::vector<Index> numbers(count);
    for (Index i = 0; i < count; ++i) {
        const Index first = i * m / count, last = (i + 1) * m / count;
        numbers[i] = first + static_cast<Index>(scrambled(i) % static_cast<std::uint64_t>(last - first));
    }
    return numbers;
}

Index sample_size(Index m) { return m < few ? 0 : std::clamp<Index>(m / 16, 1 << 11, 1 << 14); }

Brackets brackets_of(std::vector<double>& sample) {
    std::erase_if(sample, [](double value) { return value != value; });
    Brackets brackets;
    const Index n = static_cast<Index>(sample.size());
    auto begin = sample.begin();
    const auto at = [&](double place, double beyond) {
        if (place < 0.0 || place >= static_cast<double>(n)) return beyond;
        const auto nth = sample.begin() + static_cast<Index>(place);
        if (nth >= begin) std::nth_element(begin, nth, sample.end()), begin = nth;  // smaller values stay below begin
        else std::nth_element(sample.begin(), nth, begin);
        return *nth;
    };
    for (int p = 0; p < percentiles; ++p) {
        const double rank = parts[p] * n, off = deviations * std::sqrt(rank * (1.0 - parts[p])) + 2.0;
        const double low = at(rank - off, -infinity), high = at(rank + off, infinity);
        brackets[p] = {low, high, std::count(sample.begin(), sample.end(), high) > 1};
    }
    return brackets;
}

Tally::Tally() { least.fill(infinity); }

void Tally::add(const double* values, Index count, const Brackets* brackets) {
    for (Index first = 0; first < count; first += piece)
        add_piece(values + first, std::min(piece, count - first), brackets);
}

void Tally::add_piece(const double* values, Index count, const Brackets* brackets) {
    // hand-written registers: the compiler makes slow code of wider vectors, and no vector code of so many sums and
    // choices
    const Bracket none{-infinity, -infinity, false};
    const auto [a, b, c] = brackets ? *brackets : Brackets{none, none, none};
    const Index whole = count / lanes, rest = count % lanes, end = whole + (rest > 0);
    alignas(64) double last[lanes] = {}, padded[lanes];  // the rest of the piece; no value is below infinity
    std::copy_n(values + whole * lanes, rest, last);
    std::fill(std::copy_n(last, rest, padded), padded + lanes, infinity);
    Lanes sums;
    std::array<std::uint64_t, lanes> inside;  // for each lane, whether its values are in a bracket; the last at bit 0
    for (Index lane = 0; lane < lanes; lane += register_lanes) {
        Register sum{}, low;
        Counts below_a{}, below_b{}, below_c{}, marks{};
        std::memcpy(&low, &least[lane], sizeof low);
        const auto note = [&](const double* at, const double* summed) {
            Register value, term;
            std::memcpy(&value, at + lane, sizeof value);
            std::memcpy(&term, summed + lane, sizeof term);
            sum += term;
            low = value < low ? value : low;
            const Counts less_a = value < a.low, less_b = value < b.low, less_c = value < c.low;
            below_a -= less_a;  // a true comparison is −1
            below_b -= less_b;
            below_c -= less_c;
            const Counts upto_a = value < a.high, upto_b = value < b.high, upto_c = value < c.high;
            marks += marks - ((less_a ^ upto_a) | (less_b ^ upto_b) | (less_c ^ upto_c));  // valid because low ≤ high
        };
        for (Index v = 0; v < whole; ++v) note(values + v * lanes, values + v * lanes);
        if (rest) note(padded, last);
        std::memcpy(&sums.part[lane], &sum, sizeof sum);
        std::memcpy(&least[lane], &low, sizeof low);
        std::memcpy(&inside[lane], &marks, sizeof marks);
        for (Index l = 0; l < register_lanes; ++l) {
            below[0] += below_a[l];
            below[1] += below_b[l];
            below[2] += below_c[l];
        }
    }
    const double added = sums.total(), next = total + added;
    lost += (total - next) + added;
    total = next;
    static_assert(piece == 16 * lanes);
    double found[piece];
    Index number = 0;
    for (Index half = 0; brackets && half < lanes; half += lanes / 2) {  // two loops are predicted better than eight
        std::uint64_t left = 0;
        for (Index l = 0; l < lanes / 2; ++l) left |= inside[half + l] << 16 * l;
        for (; left; left &= left - 1) {
            const int bit = std::countr_zero(left);
            found[number++] = values[(end - 1 - bit % 16) * lanes + half + bit / 16];
        }
    }
    near.insert(near.end(), found, found + number);
    for (int p = 0; brackets && p < percentiles; ++p) {
        const Bracket bracket = (*brackets)[p];
        for (Index s = 0; bracket.tied && s < count; ++s) upto[p] += values[s] <= bracket.high;
    }
}

std::pair<double, double> minimum_and_mean(const std::vector<Tally>& tallies, Index m) {
    double total = 0.0, least = infinity;
    for (const Tally& tally : tallies) {
        total += tally.sum();
        least = std::min(least, *std::min_element(tally.least.begin(), tally.least.end()));
    }
    return {least, total / static_cast<double>(m)};
}

bool percentile_of(const std::vector<Tally>& tallies, Index m, Index p, const Bracket& bracket, double& found) {
    Index rank = percentile_ranks(m)[p], upto = 0, kept = 0;
    std::vector<double> inside;
    for (const Tally& tally : tallies) {
        rank -= tally.below[p];
        upto += tally.upto[p] - tally.below[p];
        inside.resize(kept + tally.near.size());
        for (double value : tally.near) {
            inside[kept] = value;
            kept += bracket.holds(value);
        }
    }
    inside.resize(kept);
    if (rank < 0 || (rank >= kept && rank >= upto)) return false;
    found = rank < kept ? select(inside, rank) : bracket.high;
    return true;
}

void Lowest::add(const double* values, Index first, Index count, double limit) {
    for (Index at = 0; at < count; at += piece) {
        const Index here = std::min(piece, count - at);
        Index low = 0;
        for (Index s = 0; s < here; ++s) low += values[at + s] <= limit;
        if (!low) continue;
        for (Index s = at; s < at + here; ++s)
            if (values[s] <= limit) add(values[s], first + s);
    }
}

void Lowest::trim() {
    if (static_cast<Index>(kept_.size()) <= count_) return;
    std::nth_element(kept_.begin(), kept_.begin() + count_, kept_.end());
    kept_.resize(count_);
}

std::pair<std::vector<double>, std::vector<Index>> Lowest::in_order() {
    trim();
    std::sort(kept_.begin(), kept_.end());
    std::pair<std::vector<double>, std::vector<Index>> found;
    for (const auto& [value, number] : kept_) {
        found.first.push_back(value);
        found.second.push_back(number);
    }
    return found;
}

Owned<double, 1> distribution(Vector<const double> values) {
    const Index m = values.size();
    require(m > 0, "values: expected at least one");
    std::vector<double> sample;
    for (Index number : sample_of(m, sample_size(m))) sample.push_back(values[number]);
    Brackets brackets;
    const Brackets* known = sample.empty() ? nullptr : &(brackets = brackets_of(sample));
    std::vector<Tally> tallies((m + block - 1) / block);
    for_ranges(m, block, [&](Index first, Index last) {
        tallies[first / block].add(values.data() + first, last - first, known);
    });
    Distribution found;
    std::tie(found[0], found[1]) = minimum_and_mean(tallies, m);
    std::array<char, percentiles> proven{};
    for_blocks(known ? percentiles : 0, [&](Index p) {
        proven[p] = percentile_of(tallies, m, p, brackets[p], found[2 + p]);
    });
    if (!std::all_of(proven.begin(), proven.end(), std::identity{})) {
        std::vector<double> all(values.begin(), values.end());
        const auto ranks = percentile_ranks(m);
        for (int p = 0; p < percentiles; ++p) {
            auto left = all;
            found[2 + p] = select(left, ranks[p]);
        }
    }
    return owned(std::vector<double>(found.begin(), found.end()));
}

Owned<Index, 1> smallest_values(Vector<const double> values, Index count) {
    require(count >= 0, "count: expected no negative number");
    const Index m = values.size(), numbers = sample_size(m);
    double limit = infinity;
    if (count > 0 && count <= numbers) {
        std::vector<double> sample;
        for (Index number : sample_of(m, numbers)) sample.push_back(values[number]);
        const double last = select(sample, count - 1);
        if (last == last) limit = last;
    }
    std::vector<Lowest> lowest((m + block - 1) / block, Lowest(count));
    for_ranges(m, block, [&](Index first, Index last) {
        lowest[first / block].add(values.data() + first, first, last - first, limit);
        lowest[first / block].trim();
    });
    Lowest all(count);
    for (const Lowest& part : lowest) all.add(part);
    return owned(all.in_order().second);
}

void count_in_bins(Vector<const double> values, double low, double scale, Vector<Index> counts) {
    require(counts.size() > 0, "counts: expected at least one bin");
    for (double value : values) ++counts[bin_of(value, low, scale, counts.size())];
}

Owned<double, 1> values_in_bin(Vector<const double> values, double low, double scale, Index bins, Index wanted) {
    require(bins > 0, "bins: expected at least one");
    std::vector<double> found;
    for (double value : values)
        if (bin_of(value, low, scale, bins) == wanted) found.push_back(value);
    return owned(std::move(found));
}

}  // namespace mesh_motion
