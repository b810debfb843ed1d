// The first root of a cubic polynomial, of a determinant whose edges change evenly.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace mesh_motion {

using Cubic = std::array<double, 4>;  // coefficients, beginning with the constant term

inline double at(const Cubic& p, double s) { return ((p[3] * s + p[2]) * s + p[1]) * s + p[0]; }

/// The root in (low, high], where the polynomial falls below 0 and has no extremum in between.
inline double root_between(const Cubic& p, double low, double high) {
    constexpr int halvings = 60;
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

/// The smallest root in (0, horizon] that `counts`, of a polynomial that is positive at 0; ∞ without one.
template <class Counts>
double first_root(const Cubic& p, double horizon, Counts&& counts) {
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
    const Cubic negative{-p[0], -p[1], -p[2], -p[3]};
    double low = 0.0;
    bool above = true;
    for (const double high : ends) {
        if ((at(p, high) <= 0.0) == above) {
            const double s = root_between(above ? p : negative, low, high);
            if (counts(s)) return s;
            above = !above;
        }
        low = high;
    }
    return std::numeric_limits<double>::infinity();
}

using Vector3 = std::array<double, 3>;

[[gnu::always_inline]] inline double triple(const Vector3& a, const Vector3& b, const Vector3& c) {
    return a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0]);
}

/// det(E + s V) of d edges, in d dimensions: it is linear in each edge, so a sum of determinants of edges of E and of V.
template <int d>
[[gnu::always_inline]] inline Cubic determinant_along(const std::array<Vector3, d>& e, const std::array<Vector3, d>& v) {
    if constexpr (d == 1) {
        return {e[0][0], v[0][0], 0.0, 0.0};
    } else if constexpr (d == 2) {
        const auto cross = [](const Vector3& a, const Vector3& b) { return a[0] * b[1] - a[1] * b[0]; };
        return {cross(e[0], e[1]), cross(e[0], v[1]) + cross(v[0], e[1]), cross(v[0], v[1]), 0.0};
    } else {
        return {triple(e[0], e[1], e[2]), triple(v[0], e[1], e[2]) + triple(v[1], e[2], e[0]) + triple(v[2], e[0], e[1]),
                triple(e[0], v[1], v[2]) + triple(e[1], v[2], v[0]) + triple(e[2], v[0], v[1]),
                triple(v[0], v[1], v[2])};
    }
}

/// Whether the polynomial may have a root in (0, end], or is not positive at 0: unless all its Bernstein coefficients on
/// (0, end) are above what rounding can change.
[[gnu::always_inline]] inline bool may_fall(const Cubic& p, double end) {
    const double a = p[1] * end, b = p[2] * (end * end), c = p[3] * (end * end * end);
    const double rounding = 1e-14 * (std::abs(p[0]) + std::abs(a) + std::abs(b) + std::abs(c));
    const double third = 1.0 / 3.0, first = p[0] + third * a, second = first + third * (a + b);
    return !((p[0] > rounding) & (first > rounding) & (second > rounding) & (p[0] + a + b + c > rounding));
}

}  // namespace mesh_motion
