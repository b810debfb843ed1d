#include "two_scale/coarse_points.h"

#include <limits>

#include "lanes.h"
#include "parallel.h"

namespace mesh_motion {
namespace {

constexpr Index block = 1 << 15;  // points in one task

/// A point's weight × squared distance to the nearest chosen point; −1 if it may not be chosen any more.
double share(double nearest, double weight, double least) {
    return (nearest >= least) & (nearest > 0.0) ? nearest * weight : -1.0;
}

}  // namespace

void drop_followers(Matrix<const Index> pairs, Vector<bool> taken) {
    require(pairs.shape(1) == 2, "pairs: expected (p, 2)");
    for (Index p = 0; p < pairs.shape(0); ++p) {
        const Index first = pairs(p, 0), second = pairs(p, 1);
        require(0 <= first && first < taken.size() && 0 <= second && second < taken.size(),
                "pairs: expected numbers of points");
        if (taken[first]) taken[second] = false;
    }
}

Index choose_farthest(Matrix<const double> points, Vector<const double> weights, double least, Vector<Index> chosen) {
    const Index n = points.shape(0);
    require(points.shape(1) == 3 && weights.size() == n, "points, weights: expected (n, 3), (n,)");
    require(chosen.size() <= n, "chosen: expected no more than there are points");
    std::vector<double> coordinates(3 * n), nearest(n, std::numeric_limits<double>::infinity());
    for (Index i = 0; i < n; ++i)
        for (Index m = 0; m < 3; ++m) coordinates[m * n + i] = points(i, m);
    const double *xs = coordinates.data(), *ys = xs + n, *zs = ys + n, *own = weights.data();
    std::vector<double> largest((n + block - 1) / block);
    Index best = 0;
    for (Index rank = 0; rank < chosen.size(); ++rank) {
        chosen[rank] = best;
        const double x = xs[best], y = ys[best], z = zs[best];
        for_ranges(n, block, [&](Index first, Index last) {
            Lanes most;
            std::fill(most.part, most.part + lanes, -1.0);
            double* __restrict left = nearest.data();
            const auto update = [&](Index i, Index l) {
                const double dx = xs[i] - x, dy = ys[i] - y, dz = zs[i] - z, square = dx * dx + dy * dy + dz * dz;
                left[i] = square < left[i] ? square : left[i];
                const double value = share(left[i], own[i], least);
                most.part[l] = value > most.part[l] ? value : most.part[l];
            };
            Index i = first;
            for (; i + lanes <= last; i += lanes)
                for (Index l = 0; l < lanes; ++l) update(i + l, l);
            for (Index l = 0; i < last; ++i, ++l) update(i, l);
            largest[first / block] = *std::max_element(most.part, most.part + lanes);
        });
        const auto winner = std::max_element(largest.begin(), largest.end());
        if (*winner < 0.0) return rank + 1;
        best = (winner - largest.begin()) * block;
        while (share(nearest[best], own[best], least) != *winner) ++best;
    }
    return chosen.size();
}

}  // namespace mesh_motion
