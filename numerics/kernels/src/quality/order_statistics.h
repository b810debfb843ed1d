// Exact percentiles of millions of values, without a sort and without the values being kept.
//
// A sample says between which two values each percentile lies, but for one in some ten thousand cases. One pass counts
// the values below and keeps the few in between. The counts prove that the percentile is among them; where it is not, a
// second pass keeps all values.
#pragma once

#include "lanes.h"
#include "parallel.h"
#include "view.h"

namespace mesh_motion {

/// Percentiles 1, 5 and 50.
inline constexpr int percentiles = 3;

/// Ranks, from 0 in ascending order, of the percentiles of m values.
std::array<Index, percentiles> percentile_ranks(Index m);

/// The value of a rank. The order of the values is lost.
double select(std::vector<double>& values, Index rank);

/// Numbers of a sample: one at random from each of `count` equal parts of 0 … m − 1.
std::vector<Index> sample_of(Index m, Index count);
/// How many of m values are a sample that bounds percentiles; 0: too few of them to be worth it.
Index sample_size(Index m);

/// Where the percentiles are: of values low ≤ v < high, or v = high where `tied` values are equal to it.
struct Bracket {
    double low, high;
    bool tied;

    bool holds(double value) const { return (value >= low) & (value < high); }
};
using Brackets = std::array<Bracket, percentiles>;

/// From a sample, of which the order is lost.
Brackets brackets_of(std::vector<double>& sample);

/// What is known of the values of a task after one pass.
class alignas(cache_line) Tally {
  public:
    Tally();
    /// The next values of the task: all but the last ones are a multiple of 128.
    void add(const double* values, Index count, const Brackets* brackets);
    /// Of all values; −∞ if one is. Values that are all alike lose digits in one direction, hence the correction.
    double sum() const { return total + (lost == lost ? lost : 0.0); }

    std::array<double, lanes> least;
    std::array<Index, percentiles> below{}, upto{};  // values < low, and ≤ high where it is tied
    std::vector<double> near;                        // in any of the brackets

  private:
    void add_piece(const double* values, Index count, const Brackets* brackets);
    double total = 0.0, lost = 0.0;
};

/// Minimum, mean and percentiles.
using Distribution = std::array<double, 2 + percentiles>;

/// Of the m values of the tallies.
std::pair<double, double> minimum_and_mean(const std::vector<Tally>& tallies, Index m);

/// Percentile p of the m values of the tallies; false if it is not where the sample said.
bool percentile_of(const std::vector<Tally>& tallies, Index m, Index p, const Bracket& bracket, double& found);

/// The lowest values of many, with their numbers; of equal ones those with the lowest numbers.
class alignas(cache_line) Lowest {
  public:
    explicit Lowest(Index count) : count_(count) {}
    /// Values with the numbers first, first + 1 …; those above the limit are left out.
    void add(const double* values, Index first, Index count, double limit);
    void add(double value, Index number) { kept_.emplace_back(value, number); }
    void add(const Lowest& other) { kept_.insert(kept_.end(), other.kept_.begin(), other.kept_.end()); }
    /// Forgets all but the `count` lowest.
    void trim();
    /// The lowest in ascending order.
    std::pair<std::vector<double>, std::vector<Index>> in_order();

  private:
    Index count_;
    std::vector<std::pair<double, Index>> kept_;
};

/// (5,) minimum, mean and percentiles 1, 5, 50 of values (m,), m ≥ 1.
Owned<double, 1> distribution(Vector<const double> values);

/// Numbers of the `count` smallest values, smallest first; of equal values the lower number first.
Owned<Index, 1> smallest_values(Vector<const double> values, Index count);

/// counts (bins,) += the values (m,) in each bin: those of bin b are low + [b, b + 1) / scale, the ends take the rest.
void count_in_bins(Vector<const double> values, double low, double scale, Vector<Index> counts);

/// The values in one of so many bins, in their order.
Owned<double, 1> values_in_bin(Vector<const double> values, double low, double scale, Index bins, Index wanted);

}  // namespace mesh_motion
