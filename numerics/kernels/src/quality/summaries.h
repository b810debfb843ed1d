// Judging a whole mesh in one pass that stores no array of its size: its worst cells, or also the distributions.
//
// Cells of all blocks have consecutive numbers; `metric` is a number of numerics/quality/metrics.py, `rest` is needed
// for the relative metric only.
#pragma once

#include "quality/cell_quality.h"

namespace mesh_motion {

using Blocks = std::vector<Matrix<const Node>>;

/// The `count` lowest values of a metric, ascending, their cells (of equal values the lower numbers), the number of
/// inverted cells, and the cells whose worst corner is below corner_limit (none if this is 0): see corner_quality.
///
/// A sample gives an upper limit of the lowest values. For tetrahedra a comparison of sixth powers finds cells that are
/// certainly above the limits, and only the others are judged: this takes about half the time of judging all.
std::tuple<Owned<double, 1>, Owned<Index, 1>, Index, Owned<Index, 1>> lowest_cells(
    Matrix<const double> points, const Blocks& blocks, Vector<const double> reference, AtRest rest, Index metric,
    Index count, double corner_limit);

/// Minimum, mean and percentiles (metrics, 5) of size, skew, size-skew and, if it is another one, the metric; the
/// `count` lowest cells of the metric, the number of inverted cells, and the cells below corner_limit as above.
std::tuple<Owned<double, 2>, Owned<Index, 1>, Index, Owned<Index, 1>> judged_cells(
    Matrix<const double> points, const Blocks& blocks, Vector<const double> reference, AtRest rest, Index metric,
    Index count, double corner_limit);

/// Metric, size, skew and size-skew (s, 4) of the cells with these numbers (s,), in their order: of the few that a
/// report names.
Owned<double, 2> values_of_cells(Matrix<const double> points, const Blocks& blocks, Vector<const double> reference,
                                 AtRest rest, Index metric, Vector<const Index> numbers);

/// Values (p, s) of a metric of the cells with these ascending numbers (s,), at multiples, the places (p,), of the step
/// from before (n, d) to points (n, d) after it.
Owned<double, 2> values_along(Matrix<const double> points, Matrix<const double> before, const Blocks& blocks,
                              Vector<const double> reference, AtRest rest, Index metric, Vector<const Index> numbers,
                              Vector<const double> places);

/// The summary of the cells of a part of a mesh: sum, minimum and maximum (metrics, 3) of the same metrics, how many
/// values are in each of equal bins (metrics, bins) of [−1, 1], the `count` lowest cells, and how many are inverted. places
/// (metrics, m) receives where each value is: its bin times the bins, plus its part of that bin, which has as many parts.
std::tuple<Owned<double, 2>, Owned<Index, 2>, Owned<Index, 1>, Index> counted_cells(
    Matrix<const double> points, const Blocks& blocks, Vector<const double> reference, AtRest rest,
    Index metric, Index count, Index bins, Matrix<std::uint32_t> places);

/// The number of these places (m,) in each part (w, bins) of the `wanted` (w,) bins.
Owned<Index, 2> counts_in_parts(Vector<const std::uint32_t> places, Vector<const std::uint32_t> wanted, Index bins);

/// The values of a metric at the `wanted` (w,) places, in the order of the cells: `places` (m,) are from the counting
/// of these cells at these points.
Owned<double, 1> values_at(Matrix<const double> points, const Blocks& blocks, Vector<const double> reference,
                           AtRest rest, Index metric, Vector<const std::uint32_t> places,
                           Vector<const std::uint32_t> wanted);

}  // namespace mesh_motion
