// Matrices with one, two or three rows, eight side by side.
#pragma once

#include "correction/pack.h"

namespace mesh_motion {

template <int d>
inline Small<d> unit() {
    Small<d> a{};
    for (int i = 0; i < d; ++i) a[i][i] += 1.0;
    return a;
}

template <int d>
inline Small<d> product(const Small<d>& a, const Small<d>& b) {
    Small<d> c{};
    for (int i = 0; i < d; ++i)
        for (int k = 0; k < d; ++k)
            for (int j = 0; j < d; ++j) c[i][k] += a[i][j] * b[j][k];
    return c;
}

/// a bᵀ.
template <int d>
inline Small<d> product_transposed(const Small<d>& a, const Small<d>& b) {
    Small<d> c{};
    for (int i = 0; i < d; ++i)
        for (int k = 0; k < d; ++k)
            for (int j = 0; j < d; ++j) c[i][k] += a[i][j] * b[k][j];
    return c;
}

/// |a|²_F.
template <int d>
inline Pack square(const Small<d>& a) {
    Pack q{};
    for (const auto& row : a)
        for (Pack x : row) q += x * x;
    return q;
}

/// cof a = d det a / da.
template <int d>
inline Small<d> cofactor(const Small<d>& a) {
    if constexpr (d == 1) {
        return unit<1>();
    } else if constexpr (d == 2) {
        return {{{a[1][1], -a[1][0]}, {-a[0][1], a[0][0]}}};
    } else {
        Small<3> c;
        for (int i = 0; i < 3; ++i)
            for (int k = 0; k < 3; ++k) {
                const int i1 = (i + 1) % 3, i2 = (i + 2) % 3, k1 = (k + 1) % 3, k2 = (k + 2) % 3;
                c[i][k] = a[i1][k1] * a[i2][k2] - a[i1][k2] * a[i2][k1];
            }
        return c;
    }
}

template <int d>
inline Pack determinant(const Small<d>& a) {
    const Small<d> c = cofactor<d>(a);
    Pack sum{};
    for (int k = 0; k < d; ++k) sum += a[0][k] * c[0][k];
    return sum;
}

/// One Jacobi rotation of the lanes that take part: a[i][j] of the symmetric a becomes 0; v is rotated too.
template <int i, int j, int d>
inline void rotate_lanes(Small<d>& a, Small<d>& v, Mask active) {
    // the smaller angle with tan 2φ = 2 a_ij / (a_jj − a_ii), from half the angle of a right triangle
    const Pack apart = a[j][j] - a[i][i], twice = active ? 2.0 * a[i][j] : all(0.0);
    const Pack hypotenuse = root(apart * apart + twice * twice), along = size_of(apart) + hypotenuse;
    const Pack scale = along > 0.0 ? 1.0 / root(along * along + twice * twice) : all(0.0);
    const Pack c = size_of(twice) > 0.0 ? along * scale : all(1.0), s = (apart < 0.0 ? -twice : twice) * scale;
    const Pack change = 0.5 * (hypotenuse - size_of(apart));
    a[i][i] -= apart < 0.0 ? -change : change;
    a[j][j] += apart < 0.0 ? -change : change;
    a[i][j] = a[j][i] = active ? all(0.0) : a[i][j];
    for (int k = 0; k < d; ++k) {
        if (k != i && k != j) {
            const Pack first = a[k][i], second = a[k][j];
            a[k][i] = a[i][k] = c * first - s * second;
            a[k][j] = a[j][k] = s * first + c * second;
        }
        const Pack first = v[k][i], second = v[k][j];
        v[k][i] = c * first - s * second;
        v[k][j] = s * first + c * second;
    }
}

/// Cyclic Jacobi: makes the symmetric a diagonal, and returns the eigenvectors as columns.
template <int d>
inline Small<d> symmetric_eigen(Small<d>& a) {
    Small<d> v = unit<d>();
    constexpr int sweeps = 12;
    constexpr double small = 1e-10;  // the last sweep squares the off-diagonal entries
    for (int sweep = 0; sweep < sweeps; ++sweep) {
        Pack off{}, size{};
        for (int i = 0; i < d; ++i) {
            size += size_of(a[i][i]);
            for (int j = 0; j < i; ++j) off += size_of(a[i][j]);
        }
        const Mask active = off > small * size;
        if (!any(active)) break;
        if constexpr (d > 1) rotate_lanes<0, 1, d>(a, v, active);
        if constexpr (d > 2) {
            rotate_lanes<0, 2, d>(a, v, active);
            rotate_lanes<1, 2, d>(a, v, active);
        }
    }
    return v;
}

/// Removes the negative part of a symmetric matrix.
template <int d>
inline void project(Small<d>& a) {
    // positive leading minors: nothing to do
    Mask positive = a[0][0] > 0.0;
    if constexpr (d > 1) positive &= a[0][0] * a[1][1] - a[0][1] * a[0][1] > 0.0;
    if constexpr (d > 2) positive &= determinant<d>(a) > 0.0;
    if (!any(~positive)) return;
    Small<d> turned = a;
    const Small<d> v = symmetric_eigen<d>(turned);
    for (int i = 0; i < d; ++i)
        for (int j = 0; j < d; ++j) {
            Pack sum{};
            for (int k = 0; k < d; ++k) sum += larger(turned[k][k], all(0.0)) * v[i][k] * v[j][k];
            a[i][j] = positive ? a[i][j] : sum;
        }
}

/// a = u diag(s) vᵀ with det u = det v = 1: only the last and smallest s may be negative.
template <int d>
struct SignedSvd {
    Small<d> u, v;
    std::array<Pack, d> s;
};

template <int d>
inline void cross(Small<d>& a) {
    if constexpr (d == 2) {
        a[0][1] = -a[1][0];
        a[1][1] = a[0][0];
    } else if constexpr (d == 3) {
        for (int r = 0; r < 3; ++r) {
            const int r1 = (r + 1) % 3, r2 = (r + 2) % 3;
            a[r][2] = a[r1][0] * a[r2][1] - a[r2][0] * a[r1][1];
        }
    }
}

/// Computed from the eigenvectors of aᵀa; the last columns of u and v follow from the others.
template <int d>
inline SignedSvd<d> signed_svd(const Small<d>& a) {
    SignedSvd<d> f{unit<d>(), unit<d>(), {}};
    if constexpr (d > 1) {
        Small<d> gram{};
        for (int i = 0; i < d; ++i)
            for (int j = 0; j < d; ++j)
                for (int r = 0; r < d; ++r) gram[i][j] += a[r][i] * a[r][j];
        f.v = symmetric_eigen<d>(gram);
        for (int i = 0; i < d - 1; ++i)
            for (int j = i + 1; j < d; ++j) {  // sort: largest first
                const Mask swap = gram[j][j] > gram[i][i];
                const Pack value = gram[i][i];
                gram[i][i] = swap ? gram[j][j] : value;
                gram[j][j] = swap ? value : gram[j][j];
                for (auto& row : f.v) {
                    const Pack first = row[i];
                    row[i] = swap ? row[j] : first;
                    row[j] = swap ? first : row[j];
                }
            }
        cross<d>(f.v);
        for (int k = 0; k < d - 1; ++k) {
            std::array<Pack, d> column{};
            for (int r = 0; r < d; ++r)
                for (int i = 0; i < d; ++i) column[r] += a[r][i] * f.v[i][k];
            // zero length: use the first axis, or another axis farther from u_0
            const Mask along_first = k ? Mask(size_of(f.u[0][0]) > 0.8) : Mask{};
            const auto orthogonal = [&](std::array<Pack, d>& x) {  // also if s_1 is lost in the rounding of aᵀa
                Pack along{};
                for (int r = 0; r < d; ++r) along += f.u[r][0] * x[r];
                for (int r = 0; r < d; ++r) x[r] -= along * f.u[r][0];
            };
            if (k) orthogonal(column);
            const auto length_of = [](const std::array<Pack, d>& x) {
                Pack sum{};
                for (Pack y : x) sum += y * y;
                return root(sum);
            };
            f.s[k] = length_of(column);
            const Mask none = ~(f.s[k] > 0.0);
            if (any(none)) {
                std::array<Pack, d> axis{};
                axis[0] = along_first ? all(0.0) : all(1.0);
                axis[1] = along_first ? all(1.0) : all(0.0);
                if (k) orthogonal(axis);
                for (int r = 0; r < d; ++r) column[r] = none ? axis[r] : column[r];
            }
            const Pack length = any(none) ? length_of(column) : f.s[k];
            for (int r = 0; r < d; ++r) f.u[r][k] = column[r] / length;
        }
        cross<d>(f.u);
    }
    for (int i = 0; i < d; ++i)
        for (int j = 0; j < d; ++j) f.s[d - 1] += f.u[i][d - 1] * a[i][j] * f.v[j][d - 1];
    return f;
}

}  // namespace mesh_motion
