#include "quality/inversion.h"

#include <array>
#include <cmath>
#include <limits>

#include "parallel.h"

namespace mesh_motion {
namespace {

constexpr Index cells_per_task = 4096;
constexpr int halvings = 60;
constexpr double never = std::numeric_limits<double>::infinity();

using Cubic = std::array<double, 4>;  // coefficients, beginning with the constant term

double at(const Cubic& p, double s) { return ((p[3] * s + p[2]) * s + p[1]) * s + p[0]; }

/// The root in (low, high], where the polynomial changes its sign and has no extremum in between.
double root_between(const Cubic& p, double low, double high) {
    double s = 0.5 * (low + high);
    for (int i = 0; i < halvings && low < high; ++i) {
        const double value = at(p, s), slope = (3.0 * p[3] * s + 2.0 * p[2]) * s + p[1];
        (value > 0.0 ? low : high) = s;
        const double next = s - value / slope;
        const double to = next > low && next < high ? next : 0.5 * (low + high);
        if (std::abs(to - s) <= 1e-15 * high) break;
        s = to;
    }
    return s;
}

/// The smallest root in (0, horizon] of a polynomial that is positive at 0.
double first_root(const Cubic& p, double horizon) {
    // the other terms are too small for a root: true for most cells of a small step
    double least = p[0], power = 1.0;
    for (int k = 1; k < 4; ++k) least += std::min(p[k], 0.0) * (power *= horizon);
    if (least > 0.0) return never;
    // between its extrema it is monotonic
    std::array<double, 3> ends{horizon, horizon, horizon};
    const double a = 3.0 * p[3], b = 2.0 * p[2], c = p[1], root = b * b - 4.0 * a * c;
    if (root >= 0.0) {
        const double q = -0.5 * (b + std::copysign(std::sqrt(root), b));
        for (int k = 0; k < 2; ++k) {
            const double s = k == 0 ? q / a : c / q;
            if (s > 0.0 && s < horizon) ends[k] = s;
        }
        if (ends[0] > ends[1]) std::swap(ends[0], ends[1]);
    }
    double low = 0.0;
    for (const double high : ends) {
        if (at(p, high) <= 0.0) return root_between(p, low, high);
        low = high;
    }
    return never;
}

template <int d>
double determinant(const std::array<std::array<double, d>, d>& a) {
    if constexpr (d == 1)
        return a[0][0];
    else if constexpr (d == 2)
        return a[0][0] * a[1][1] - a[0][1] * a[1][0];
    else
        return a[0][0] * (a[1][1] * a[2][2] - a[1][2] * a[2][1]) - a[0][1] * (a[1][0] * a[2][2] - a[1][2] * a[2][0]) +
               a[0][2] * (a[1][0] * a[2][1] - a[1][1] * a[2][0]);
}

/// det(E + s V) is linear in each edge: a sum of determinants, one for each choice of E's or V's edges.
template <int d>
Cubic determinant_along(const std::array<std::array<double, d>, d>& now, const std::array<std::array<double, d>, d>& on) {
    Cubic p{};
    for (int choice = 0; choice < 1 << d; ++choice) {
        std::array<std::array<double, d>, d> edges;
        int degree = 0;
        for (int k = 0; k < d; ++k) {
            const bool moves = choice >> k & 1;
            edges[k] = moves ? on[k] : now[k];
            degree += moves;
        }
        p[degree] += determinant<d>(edges);
    }
    return p;
}

template <int d>
double until_inverted(Matrix<const double> points, Matrix<const double> step, Vector<const Node> cell,
                      Matrix<const Index> corners, double horizon) {
    double least = never;
    for (Index corner = 0; corner < corners.shape(0); ++corner) {
        const Node first = cell(corners(corner, 0));
        std::array<std::array<double, d>, d> now, on;
        for (int k = 0; k < d; ++k) {
            const Node other = cell(corners(corner, k + 1));
            for (int i = 0; i < d; ++i) {
                now[k][i] = points(other, i) - points(first, i);
                on[k][i] = step(other, i) - step(first, i);
            }
        }
        const Cubic p = determinant_along<d>(now, on);
        if (!(p[0] > 0.0)) return 0.0;
        least = std::min(least, first_root(p, std::min(horizon, least)));
    }
    return least;
}

}  // namespace

void steps_to_inversion(Matrix<const double> points, Matrix<const double> step, Matrix<const Node> nodes,
                        Matrix<const Index> corners, double horizon, Vector<double> steps) {
    const Index d = points.shape(1), n = points.shape(0);
    require(d >= 1 && d <= 3 && step.shape() == points.shape(), "points, step: expected shapes (n, 1, 2 or 3)");
    require(corners.shape(1) == d + 1 && steps.size() == nodes.shape(0), "corners, steps: expected (q, d + 1), (m,)");
    require(std::all_of(nodes.begin(), nodes.end(), [&](Node node) { return 0 <= node && node < n; }),
            "nodes: expected rows of points");
    require(std::all_of(corners.begin(), corners.end(), [&](Index local) { return 0 <= local && local < nodes.shape(1); }),
            "corners: expected columns of nodes");
    require(horizon > 0.0, "horizon: expected a positive number");
    const auto of = d == 1 ? until_inverted<1> : d == 2 ? until_inverted<2> : until_inverted<3>;
    for_ranges(nodes.shape(0), cells_per_task, [&](Index first, Index last) {
        for (Index c = first; c < last; ++c) steps(c) = of(points, step, nodes[c], corners, horizon);
    });
}

}  // namespace mesh_motion
