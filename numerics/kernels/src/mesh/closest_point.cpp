#include "mesh/closest_point.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "parallel.h"

namespace mesh_motion {
namespace {

constexpr Index points_per_task = 64;  // of some hundred candidates each

using Vec = std::array<double, 3>;

constexpr double beyond = 1e-9;        // share of a facet by which a point may be outside
constexpr int newton_iterations = 20;  // on a triangle: three or four iterations if the point is near

Vec read(Vector<const double> row) { return {row[0], row[1], row[2]}; }
Vec operator-(const Vec& a, const Vec& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
Vec operator+(const Vec& a, const Vec& b) { return {a[0] + b[0], a[1] + b[1], a[2] + b[2]}; }
Vec operator*(double f, const Vec& a) { return {f * a[0], f * a[1], f * a[2]}; }
Vec cross(const Vec& a, const Vec& b) {
    return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
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

Vec on_facet(const Vec& p, Matrix<const double> corners) {
    const Vec a = read(corners[0]), b = read(corners[1]);
    return corners.shape(0) == 2 ? on_segment(p, a, b) : on_triangle(p, a, b, read(corners[2]));
}

void check_shapes(Matrix<const double> points, Cube<const double> corners) {
    require(points.shape(1) == 3 && corners.shape(2) == 3 && (corners.shape(1) == 2 || corners.shape(1) == 3),
            "points, corners: expected shapes (n, 3) and (f, 2 or 3, 3)");
}

void check_numbers(Vector<const Index> facets, Index count) {
    require(std::all_of(facets.begin(), facets.end(), [&](Index facet) { return 0 <= facet && facet < count; }),
            "candidates: expected numbers of facets");
}

void check(Matrix<const double> points, Cube<const double> corners, Vector<const Index> starts,
           Vector<const Index> candidates, Matrix<double> out) {
    const Index n = points.shape(0);
    check_shapes(points, corners);
    require(starts.size() == n + 1 && out.shape() == points.shape(), "starts, out: expected shapes (n + 1,), (n, 3)");
    require(std::is_sorted(starts.begin(), starts.end()) && starts[0] >= 0 && starts[n] <= candidates.size(),
            "starts: expected ascending places in candidates");
    check_numbers(candidates, corners.shape(0));
}

/// The point q(t) of a segment with (p − q) · d = 0 for its interpolated direction d(t); returns false if there is
/// none.
bool across_segment(const Vec& p, Matrix<const double> ends, Matrix<const double> directions, Vec& out) {
    const Vec a = read(ends[0]), ab = read(ends[1]) - a, d = read(directions[0]), turn = read(directions[1]) - d;
    const Vec ap = p - a;
    const double constant = dot(ap, d), linear = dot(ap, turn) - dot(ab, d), quadratic = -dot(ab, turn);
    const double root = linear * linear - 4.0 * quadratic * constant;
    if (root < 0.0) return false;
    const double below = 0.5 * (std::sqrt(root) - linear);  // > 0 on this side of the centre of curvature
    if (below <= 0.0 || constant < -beyond * below || constant > (1.0 + beyond) * below) return false;
    out = a + std::clamp(constant / below, 0.0, 1.0) * ab;
    return true;
}

/// The point q(u, v) of a triangle with p = q + h n for its interpolated normal n(u, v); returns false if there is
/// none.
bool along_normal(const Vec& p, Matrix<const double> corners, Matrix<const double> normals, Vec& out) {
    const Vec a = read(corners[0]), ab = read(corners[1]) - a, ac = read(corners[2]) - a, ap = p - a;
    const Vec n = read(normals[0]), turn_b = read(normals[1]) - n, turn_c = read(normals[2]) - n;
    double u = 1.0 / 3.0, v = 1.0 / 3.0, h = 0.0;
    bool ended = false;
    for (int i = 0; i < newton_iterations && !ended; ++i) {
        const Vec normal = n + u * turn_b + v * turn_c, along_u = ab + h * turn_b, along_v = ac + h * turn_c;
        const Vec miss = ap - (u * ab + v * ac + h * normal), across = cross(along_u, along_v);
        const double det = dot(across, normal);
        if (!(std::abs(det) > 0.0)) return false;
        const double du = dot(cross(along_v, normal), miss) / det, dv = dot(cross(normal, along_u), miss) / det;
        u += du, v += dv, h += dot(across, miss) / det;
        ended = std::abs(du) + std::abs(dv) < 1e-14;
        if (std::abs(u) + std::abs(v) > 1e3) return false;
    }
    if (!(u >= -beyond && v >= -beyond && u + v <= 1.0 + beyond)) return false;
    u = std::max(u, 0.0), v = std::max(v, 0.0);
    const double sum = std::max(u + v, 1.0);
    out = a + (u / sum) * ab + (v / sum) * ac;
    return true;
}

/// A tree of boxes: one box around all facets, then boxes around each half of them, and so on. Facets may differ in
/// size.
class FacetBoxes {
  public:
    explicit FacetBoxes(Cube<const double> corners) : corners_(corners), order_(corners.shape(0)) {
        std::iota(order_.begin(), order_.end(), Index{0});
        if (!order_.empty()) divide(0, static_cast<Index>(order_.size()));
    }

    bool has_within(const Vec& p, double distance) const {
        const double most = distance * distance * (1.0 + 1e-9);  // larger, so that rounding leaves out no box
        for (std::size_t at = 0; at < boxes_.size();) {
            const Box& box = boxes_[at];
            double away = 0.0;
            for (std::size_t axis = 0; axis < 3; ++axis) {
                const double out = std::max({box.low[axis] - p[axis], p[axis] - box.high[axis], 0.0});
                away += out * out;
            }
            if (away > most) {
                at = box.behind;
                continue;
            }
            if (box.last - box.first <= facets_per_box)
                for (Index i = box.first; i < box.last; ++i)
                    if (std::sqrt(square(p - on_facet(p, corners_[order_[i]]))) <= distance) return true;
            ++at;
        }
        return false;
    }

  private:
    /// The box's halves follow it; `behind` is the first box that is not inside.
    struct Box {
        Vec low, high;
        Index first, last;
        std::size_t behind;
    };

    void divide(Index first, Index last) {
        constexpr double infinity = std::numeric_limits<double>::infinity();
        Box box{{infinity, infinity, infinity}, {-infinity, -infinity, -infinity}, first, last, 0};
        for (Index i = first; i < last; ++i)
            for (Index corner = 0; corner < corners_.shape(1); ++corner)
                for (std::size_t axis = 0; axis < 3; ++axis) {
                    const double x = corners_(order_[i], corner, axis);
                    box.low[axis] = std::min(box.low[axis], x), box.high[axis] = std::max(box.high[axis], x);
                }
        const std::size_t at = boxes_.size();
        boxes_.push_back(box);
        if (last - first > facets_per_box) {
            const Vec size = box.high - box.low;
            const Index axis = std::max_element(size.begin(), size.end()) - size.begin();
            const auto middle = [&](Index facet) {
                double sum = 0.0;
                for (Index corner = 0; corner < corners_.shape(1); ++corner) sum += corners_(facet, corner, axis);
                return sum;
            };
            const Index half = (first + last) / 2;
            std::nth_element(order_.begin() + first, order_.begin() + half, order_.begin() + last,
                             [&](Index one, Index other) { return middle(one) < middle(other); });
            divide(first, half);
            divide(half, last);
        }
        boxes_[at].behind = boxes_.size();
    }

    static constexpr Index facets_per_box = 8;
    Cube<const double> corners_;
    std::vector<Index> order_;
    std::vector<Box> boxes_;
};

}  // namespace

void points_near_facets(Matrix<const double> points, Cube<const double> corners, double distance, Vector<bool> near) {
    check_shapes(points, corners);
    require(near.size() == points.shape(0), "near: expected shape (n,)");
    require(std::all_of(corners.begin(), corners.end(), [](double x) { return std::isfinite(x); }),
            "corners: expected finite numbers");
    const FacetBoxes boxes(corners);
    for_ranges(near.size(), points_per_task, [&](Index first, Index last) {
        for (Index i = first; i < last; ++i) near[i] = boxes.has_within(read(points[i]), distance);
    });
}

void closest_points(Matrix<const double> points, Cube<const double> corners, Vector<const Index> starts,
                    Vector<const Index> candidates, Matrix<double> out, Vector<Index> facets) {
    const Index n = points.shape(0);
    require(facets.size() == n, "facets: expected shape (n,)");
    check(points, corners, starts, candidates, out);
    for_ranges(n, points_per_task, [&](Index first, Index last) {
        for (Index i = first; i < last; ++i) {
            const Vec p = read(points[i]);
            double best = std::numeric_limits<double>::infinity();
            for (Index at = starts[i]; at < starts[i + 1]; ++at) {
                const Vec trial = on_facet(p, corners[candidates[at]]);
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

void smooth_points(Matrix<const double> points, Cube<const double> corners, Cube<const double> directions,
                   Vector<const Index> nearest, Vector<const Index> starts, Vector<const Index> candidates,
                   Matrix<double> out) {
    const Index n = points.shape(0);
    require(directions.shape() == corners.shape() && nearest.size() == n,
            "directions, nearest: expected shapes (f, 2 or 3, 3), (n,)");
    check(points, corners, starts, candidates, out);
    check_numbers(nearest, corners.shape(0));
    const bool segments = corners.shape(1) == 2;
    for_ranges(n, points_per_task, [&](Index first, Index last) {
        for (Index i = first; i < last; ++i) {
            const Vec p = read(points[i]);
            double best = std::numeric_limits<double>::infinity();
            const auto consider = [&](Index facet) {
                if (square(p - on_facet(p, corners[facet])) >= best) return;
                Vec trial;
                const bool found = segments ? across_segment(p, corners[facet], directions[facet], trial)
                                            : along_normal(p, corners[facet], directions[facet], trial);
                if (!found || square(p - trial) >= best) return;
                best = square(p - trial);
                std::copy(trial.begin(), trial.end(), out[i].begin());
            };
            consider(nearest[i]);
            for (Index at = starts[i]; at < starts[i + 1]; ++at) consider(candidates[at]);
        }
    });
}

}  // namespace mesh_motion
