#include "mesh/closest_point.h"

#include <algorithm>
#include <limits>

#include "parallel.h"

namespace mesh_motion {
namespace {

constexpr Index points_per_task = 64;  // of some hundred candidates each

using Vec = std::array<double, 3>;

Vec read(Vector<const double> row) { return {row[0], row[1], row[2]}; }
Vec operator-(const Vec& a, const Vec& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
double dot(const Vec& a, const Vec& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
double square(const Vec& a) { return dot(a, a); }

Vec on_segment(const Vec& p, const Vec& a, const Vec& b) {
    const Vec ab = b - a;
    const double length = square(ab);
    const double t = length > 0.0 ? std::clamp(dot(p - a, ab) / length, 0.0, 1.0) : 0.0;
    return {a[0] + t * ab[0], a[1] + t * ab[1], a[2] + t * ab[2]};
}

/// Inside if the barycentric coordinates are positive, else on an edge (C. Ericson, Real-Time Collision Detection,
/// Morgan Kaufmann 2005, §5.1.5).
Vec on_triangle(const Vec& p, const Vec& a, const Vec& b, const Vec& c) {
    const Vec ab = b - a, ac = c - a, ap = p - a;
    const double d00 = square(ab), d01 = dot(ab, ac), d11 = square(ac), d20 = dot(ap, ab), d21 = dot(ap, ac);
    const double det = d00 * d11 - d01 * d01;
    if (det > 0.0) {
        const double v = (d11 * d20 - d01 * d21) / det, w = (d00 * d21 - d01 * d20) / det;
        if (v >= 0.0 && w >= 0.0 && v + w <= 1.0)
            return {a[0] + v * ab[0] + w * ac[0], a[1] + v * ab[1] + w * ac[1], a[2] + v * ab[2] + w * ac[2]};
    }
    Vec best = on_segment(p, a, b);
    for (const Vec& trial : {on_segment(p, b, c), on_segment(p, c, a)})
        if (square(p - trial) < square(p - best)) best = trial;
    return best;
}

}  // namespace

void closest_points(Matrix<const double> points, Cube<const double> corners, Vector<const Index> starts,
                    Vector<const Index> candidates, Matrix<double> out, Vector<Index> facets) {
    const Index n = points.shape(0);
    require(points.shape(1) == 3 && corners.shape(2) == 3 && (corners.shape(1) == 2 || corners.shape(1) == 3),
            "points, corners: expected shapes (n, 3) and (f, 2 or 3, 3)");
    require(starts.size() == n + 1 && out.shape() == points.shape() && facets.size() == n,
            "starts, out, facets: expected shapes (n + 1,), (n, 3), (n,)");
    require(std::is_sorted(starts.begin(), starts.end()) && starts[0] >= 0 && starts[n] <= candidates.size(),
            "starts: expected ascending places in candidates");
    require(std::all_of(candidates.begin(), candidates.end(),
                        [&](Index facet) { return 0 <= facet && facet < corners.shape(0); }),
            "candidates: expected numbers of facets");
    const bool segments = corners.shape(1) == 2;
    for_ranges(n, points_per_task, [&](Index first, Index last) {
        for (Index i = first; i < last; ++i) {
            const Vec p = read(points[i]);
            double best = std::numeric_limits<double>::infinity();
            for (Index at = starts[i]; at < starts[i + 1]; ++at) {
                const Matrix<const double> facet = corners[candidates[at]];
                const Vec a = read(facet[0]), b = read(facet[1]);
                const Vec trial = segments ? on_segment(p, a, b) : on_triangle(p, a, b, read(facet[2]));
                const double away = square(p - trial);
                if (away < best) {
                    best = away;
                    std::copy(trial.begin(), trial.end(), out[i].begin());
                    facets[i] = candidates[at];
                }
            }
        }
    });
}

}  // namespace mesh_motion
