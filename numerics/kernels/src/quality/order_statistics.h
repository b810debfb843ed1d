// Exact percentiles of millions of values, without sorting or storing them.
//
// A sample gives two values between which each percentile lies, except in one of some ten thousand cases. One pass
// counts the values below and keeps the few in between. The counts prove that the percentile is among the kept values;
// if it is not, a second pass keeps all values.
#pragma once

#include "lanes.h"
#include "parallel.h"
#include "view.h"

namespace mesh_motion {

/// Percentiles 1, 5 and 50.
inline constexpr int percentiles = 3;

/// Ranks, from 0 in ascending order, of the percentiles of m values.
std::array<Index, percentiles> percentile_ranks(Index m);

/// The value of a rank. The values are reordered.
double select(std::vector<double>& values, Index rank);

/// Numbers of a sample: a random one from each of `count` equal parts of 0 … m − 1.
std::vector<Index> sample_of(Index m, Index count);
/// Size of a sample that bounds the percentiles of m values; 0 if there are too few values.
Index sample_size(Index m);

/// The place of a percentile: among the values low ≤ v < high. If `tied`, several values equal high, and it may also be
/// high.
struct Bracket {
    double low, high;
    bool tied;

    bool holds(double value) const { return (value >= low) & (value < high); }
};
using Brackets = std::array<Bracket, percentiles>;

/// Makes brackets from a sample; the sample is reordered.
Brackets brackets_of(std::vector<double>& sample);

/// The data about a task's values after one pass.
class alignas(cache_line) Tally {
  public:
    Tally();
    /// Adds the next values of the task: each call but the last has a multiple of 128 values.
    void add(const double* values, Index count, const Brackets* brackets);
    /// Sum of all values; −∞ if one value is −∞. Sums of nearly equal values lose digits in one direction, hence the
    /// correction.
    double sum() const { return total + (lost == lost ? lost : 0.0); }

    std::array<double, lanes> least;
    std::array<Index, percentiles> below{}, upto{};  // values < low, and ≤ high if tied
    std::vector<double> near;                        // values in any of the brackets

  private:
    void add_piece(const double* values, Index count, const Brackets* brackets);
    double total = 0.0, lost = 0.0;
};

/// Minimum, mean and percentiles.
using Distribution = std::array<double, 2 + percentiles>;

/// The minimum and mean of the m values of the tallies.
std::pair<double, double> minimum_and_mean(const std::vector<Tally>& tallies, Index m);

/// Percentile p of the m values of the tallies; false if it is not inside its bracket.
bool percentile_of(const std::vector<Tally>& tallies, Index m, Index p, const Bracket& bracket, double& found);

/// The lowest of many values, with their numbers; of equal values those with the lowest numbers.
class alignas(cache_line) Lowest {
  public:
    explicit Lowest(Index count) : count_(count) {}
    /// Adds values with the numbers first, first + 1 …; values above the limit are left out.
    void add(const double* values, Index first, Index count, double limit);
    void add(double value, Index number) { kept_.emplace_back(value, number); }
    void add(const Lowest& other) { kept_.insert(kept_.end(), other.kept_.begin(), other.kept_.end()); }
    /// Removes all but the `count` lowest values.
    void trim();
    /// The lowest values in ascending order.
    std::pair<std::vector<double>, std::vector<Index>> in_order();

  private:
    Index count_;
    std::vector<std::pair<double, Index>> kept_;
};

/// (5,) minimum, mean and percentiles 1, 5, 50 of values (m,), m ≥ 1.
Owned<double, 1> distribution(Vector<const double> values);

/// Numbers of the `count` smallest values, smallest first; of equal values the lower number first.
Owned<Index, 1> smallest_values(Vector<const double> values, Index count);

/// Adds to counts (bins,) the number of values (m,) in each bin: bin b has the values low + [b, b + 1) / scale, the
/// first and last bin also those outside.
void count_in_bins(Vector<const double> values, double low, double scale, Vector<Index> counts);

/// The values in one of the bins, in their order.
Owned<double, 1> values_in_bin(Vector<const double> values, double low, double scale, Index bins, Index wanted);

}  // namespace mesh_motion
