#include "far_field/group_sums.h"

#include "far_field/gathered.h"
#include "parallel.h"

namespace mesh_motion {
namespace {

constexpr Index groups = 4;  // of one task: they differ much in their work

}  // namespace

void sum_groups(int code, Matrix<const double> points, Matrix<const Index> points_of, Vector<const Index> starts,
                Matrix<const Index> runs, Matrix<const double> centres, Matrix<const double> weights,
                double inverse_radius, Matrix<double> out) {
    const Index n = points_of.shape(0), nc = centres.shape(1);
    require(points.shape(1) == 3 && out.shape(0) == points.shape(0) && out.shape(1) == weights.shape(0),
            "points, out: expected (n, 3), (n, k)");
    require(centres.shape(0) == 3 && weights.shape(1) == nc, "centres, weights: expected (3, nc), (k, nc)");
    require(points_of.shape(1) == 2 && runs.shape(1) == 2 && starts.size() == n + 1,
            "points_of, runs, starts: expected (g, 2), (r, 2), (g + 1,)");
    for (Index g = 0; g < n; ++g) {
        require(0 <= points_of(g, 0) && points_of(g, 1) <= points.shape(0), "points_of: expected numbers of points");
        require(0 <= starts[g] && starts[g + 1] <= runs.shape(0), "starts: expected numbers of runs");
    }
    for (Index r = 0; r < runs.shape(0); ++r)
        require(0 <= runs(r, 0) && runs(r, 0) <= runs(r, 1) && runs(r, 1) <= nc, "runs: expected numbers of centres");
    with_basis(code, [&](auto basis) {
        for_ranges(n, groups, [&](Index first, Index last) {
            for (Index g = first; g < last; ++g) {
                Index count = 0;
                for (Index run = starts[g]; run < starts[g + 1]; ++run) count += runs(run, 1) - runs(run, 0);
                const Gathered near(centres, weights, count, [&](auto&& add) {
                    for (Index run = starts[g]; run < starts[g + 1]; ++run)
                        for (Index j = runs(run, 0); j < runs(run, 1); ++j) add(j);
                });
                for (Index i = points_of(g, 0); i < points_of(g, 1); ++i)
                    near.sum<decltype(basis)>(point_of(points, i), inverse_radius, out[i]);
            }
        });
    });
}

}  // namespace mesh_motion
