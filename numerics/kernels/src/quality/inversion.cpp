#include "quality/inversion.h"

#include <array>
#include <cmath>
#include <limits>

#include "parallel.h"
#include "quality/jacobians.h"
#include "quality/order_statistics.h"

namespace mesh_motion {
namespace {

constexpr Index sampled = 1 << 13;  // number of cells that give the limit for all
constexpr Index together = 32;      // cells of which positions and motion fit into the fastest cache
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
        if (std::abs(next - s) <= 1e-12 * s) return std::clamp(next, low, high);  // its error is the square of this
        s = next > low && next < high ? next : 0.5 * (low + high);
    }
    return s;
}

/// The smallest root in (0, horizon] of a polynomial that is positive at 0.
double first_root(const Cubic& p, double horizon) {
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

using Vector3 = std::array<double, 3>;

[[gnu::always_inline]] inline double triple(const Vector3& a, const Vector3& b, const Vector3& c) {
    return a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0]);
}

/// det(E + s V) of one corner of cell s: it is linear in each edge, so a sum of determinants of edges of E and of V.
template <int d>
[[gnu::always_inline]] inline Cubic determinant_along(const Jacobians<d>& now, const Jacobians<d>& on, Index s) {
    const auto edge = [s](const Jacobians<d>& all, int j) {
        Vector3 of{};
        for (int i = 0; i < d; ++i) of[i] = all.entry[i][j][s];
        return of;
    };
    if constexpr (d == 1) {
        return {now.entry[0][0][s], on.entry[0][0][s], 0.0, 0.0};
    } else if constexpr (d == 2) {
        const Vector3 e0 = edge(now, 0), e1 = edge(now, 1), v0 = edge(on, 0), v1 = edge(on, 1);
        const auto cross = [](const Vector3& a, const Vector3& b) { return a[0] * b[1] - a[1] * b[0]; };
        return {cross(e0, e1), cross(e0, v1) + cross(v0, e1), cross(v0, v1), 0.0};
    } else {
        const Vector3 e0 = edge(now, 0), e1 = edge(now, 1), e2 = edge(now, 2);
        const Vector3 v0 = edge(on, 0), v1 = edge(on, 1), v2 = edge(on, 2);
        return {triple(e0, e1, e2), triple(v0, e1, e2) + triple(v1, e2, e0) + triple(v2, e0, e1),
                triple(e0, v1, v2) + triple(e1, v2, v0) + triple(e2, v0, v1), triple(v0, v1, v2)};
    }
}

/// Whether the polynomial may have a root in (0, end], or is not positive at 0: unless all its Bernstein coefficients on
/// (0, end) are above what rounding can change.
[[gnu::always_inline]] inline bool may_invert(const Cubic& p, double end) {
    const double a = p[1] * end, b = p[2] * (end * end), c = p[3] * (end * end * end);
    const double rounding = 1e-14 * (std::abs(p[0]) + std::abs(a) + std::abs(b) + std::abs(c));
    const double third = 1.0 / 3.0, first = p[0] + third * a, second = first + third * (a + b);
    return !((p[0] > rounding) & (first > rounding) & (second > rounding) & (p[0] + a + b + c > rounding));
}

/// Steps (m,) to inversion of the cells with these nodes (m, k), up to the horizon.
template <class Type>
void until_inverted(Matrix<const double> points, Matrix<const double> step, Matrix<const Node> nodes, double horizon,
                    double* steps) {
    constexpr int d = Type::dimension;
    for (Index first = 0; first < nodes.shape(0); first += together) {
        const Index count = std::min(together, nodes.shape(0) - first);
        const Rows rows(points, nodes, first, count);
        const auto positions = from_points<Type>(points, count, rows.cells<Type>(), rows.inside);
        const auto motion = from_points<Type>(step, count, rows.cells<Type>(), rows.inside);
        Jacobians<d> now, on;
        double* found = steps + first;
        std::fill_n(found, count, never);
        for (int k = 0; k < static_cast<int>(Type::corners.size()); ++k) {
            positions(k, now);
            motion(k, on);
            Index may[together], any = 0;
            for (Index s = 0; s < count; ++s) any += may[s] = may_invert(determinant_along<d>(now, on, s), horizon);
            for (Index s = 0; any && s < count; ++s) {
                if (!may[s]) continue;
                const Cubic p = determinant_along<d>(now, on, s);
                found[s] = p[0] > 0.0 ? std::min(found[s], first_root(p, std::min(horizon, found[s]))) : 0.0;
            }
        }
    }
}

using UntilInverted = void (*)(Matrix<const double>, Matrix<const double>, Matrix<const Node>, double, double*);

/// An upper limit for the `count` smallest steps of m cells, at most the horizon.
double limit_of(Matrix<const double> points, Matrix<const double> step, const std::vector<Matrix<const Node>>& blocks,
                const std::vector<UntilInverted>& until, Index m, double horizon, Index count) {
    if (m <= sampled) return horizon;
    std::vector<double> found;
    for (std::size_t b = 0; b < blocks.size(); ++b) {
        const Index width = blocks[b].shape(1);
        std::vector<Node> nodes;
        for (Index c = 0; c < blocks[b].shape(0); c += m / sampled)
            nodes.insert(nodes.end(), blocks[b][c].begin(), blocks[b][c].end());
        const Matrix<const Node> rows(nodes.data(), {static_cast<Index>(nodes.size()) / width, width});
        const Index before = static_cast<Index>(found.size());
        found.resize(before + rows.shape(0));
        for_ranges(rows.shape(0), judged_at_once, [&](Index first, Index last) {
            until[b](points, step, rows.rows(first, last), horizon, &found[before + first]);
        });
    }
    return count > static_cast<Index>(found.size()) ? horizon : std::min(horizon, select(found, count - 1));
}

}  // namespace

std::pair<Owned<double, 1>, Owned<Index, 1>> first_inversions(Matrix<const double> points, Matrix<const double> step,
                                                              const std::vector<Matrix<const Node>>& blocks,
                                                              double horizon, Index count) {
    require(step.shape() == points.shape(), "step: expected the shape of points");
    require(horizon > 0.0 && count > 0, "horizon, count: expected positive numbers");
    std::vector<UntilInverted> until;
    Index m = 0;
    for (const auto& nodes : blocks) {
        until.push_back(with_cell_type(points.shape(1), nodes.shape(1),
                                       []<class Type>(Type) -> UntilInverted { return until_inverted<Type>; }));
        m += nodes.shape(0);
    }
    const double limit = limit_of(points, step, blocks, until, m, horizon, count);
    Lowest all(count);
    Index origin = 0;
    for (std::size_t b = 0; b < blocks.size(); ++b) {
        const Index own = blocks[b].shape(0);
        std::vector<Lowest> lowest((own + judged_at_once - 1) / judged_at_once, Lowest(count));
        for_ranges(own, judged_at_once, [&](Index begin, Index end) {
            Lowest& here = lowest[begin / judged_at_once];
            for_chunks(begin, end, [&](Index first, Index n) {
                double steps[chunk];
                until[b](points, step, blocks[b].rows(first, first + n), limit, steps);
                here.add(steps, origin + first, n, limit);
            });
            here.trim();
        });
        for (const Lowest& part : lowest) all.add(part);
        origin += own;
    }
    auto [steps, numbers] = all.in_order();
    std::vector<Index> inverting(numbers);
    std::sort(inverting.begin(), inverting.end());
    for (Index c = 0, k = 0; c < m && static_cast<Index>(numbers.size()) < count; ++c) {  // cells without a root
        if (k < static_cast<Index>(inverting.size()) && inverting[k] == c) {
            ++k;
            continue;
        }
        steps.push_back(never);
        numbers.push_back(c);
    }
    return {owned(std::move(steps)), owned(std::move(numbers))};
}

}  // namespace mesh_motion
