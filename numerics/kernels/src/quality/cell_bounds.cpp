#include "quality/cell_bounds.h"

#include <cmath>
#include <limits>

#include "parallel.h"
#include "quality/cell_quality.h"

namespace mesh_motion {
namespace {

constexpr Index block = 512;             // cells in one task
constexpr double rounding = 1.0 - 1e-9;  // the largest rounding error of a bound that is exact in real numbers
constexpr double infinity = std::numeric_limits<double>::infinity();

/// Number of terms of a cubic polynomial in d variables without its constant.
constexpr Index terms_of(int d) { return d + d * (d + 1) / 2 + d * (d + 1) * (d + 2) / 6; }

/// Displacement at y from the group's centre, minus that of the centre itself.
template <int d>
std::array<double, d> polynomial(const std::array<double, d>& y, const double* coefficients) {
    std::array<double, d> found{};
    for (double& total : found) {
        for (int a = 0; a < d; ++a) total += *coefficients++ * y[a];
        for (int a = 0; a < d; ++a)
            for (int b = a; b < d; ++b) total += *coefficients++ * y[a] * y[b];
        for (int a = 0; a < d; ++a)
            for (int b = a; b < d; ++b)
                for (int e = b; e < d; ++e) total += *coefficients++ * y[a] * y[b] * y[e];
    }
    return found;
}

template <int d>
using Square = std::array<std::array<double, d>, d>;

template <int d>
double determinant(const Square<d>& j) {
    if constexpr (d == 1) return j[0][0];
    else if constexpr (d == 2) return j[0][0] * j[1][1] - j[0][1] * j[1][0];
    else
        return j[0][0] * (j[1][1] * j[2][2] - j[2][1] * j[1][2]) + j[1][0] * (j[2][1] * j[0][2] - j[0][1] * j[2][2]) +
               j[2][0] * (j[0][1] * j[1][2] - j[1][1] * j[0][2]);
}

/// |W⁻¹|: the square root of the largest eigenvalue of G.
template <class Type>
constexpr double inverse_norm = 0.0;
template <>
constexpr double inverse_norm<Triangle> = 1.4142135623730951;  // √2
template <>
constexpr double inverse_norm<Tetra> = 1.4142135623730951;
template <>
constexpr double inverse_norm<Pyramid> = 1.8477590650225735;  // √(2 + √2)

/// f_k of a corner; for its bound with √(Σ δ²), Π (|J_i| + δ_i) and the smallest determinant.
template <class Type>
double shape_term([[maybe_unused]] const Square<Type::dimension>& j, [[maybe_unused]] double product,
                  [[maybe_unused]] double slack, [[maybe_unused]] double det) {
    constexpr int d = Type::dimension;
    if constexpr (Type::formula == Formula::length) {
        return 1.0;
    } else {
        double ratio = det / Type::ideal, scale = 1.0;
        if constexpr (Type::formula == Formula::angles) {
            ratio /= product;
        } else {
            double square = 0.0;
            for (int a = 0; a < d; ++a)
                for (int b = 0; b < d; ++b)
                    for (int i = 0; i < d; ++i) square += Type::gram[a][b] * j[i][a] * j[i][b];
            const double norm = std::sqrt(std::max(square, 0.0)) + slack * inverse_norm<Type>;
            scale = norm * norm / d;
        }
        if constexpr (d == 2) return scale / ratio;
        const double root = inverse_cube_root(ratio);
        return ratio > 1e-290 ? scale * root * root : infinity;
    }
}

template <class Type>
void bound(const double* points, const Node* nodes, double reference, const double* middle, const double* coefficients,
           double epsilon, std::array<double, 2>& modelled, std::array<double, 2>& least) {
    constexpr int d = Type::dimension, n = static_cast<int>(Type::corners.size());
    std::array<std::array<double, d>, Type::nodes> moved;
    for (int k = 0; k < Type::nodes; ++k) {
        std::array<double, d> y;
        for (int i = 0; i < d; ++i) y[i] = points[Index{nodes[k]} * d + i] - middle[i];
        moved[k] = polynomial<d>(y, coefficients);
    }
    double total = 0.0, low = 0.0, high = 0.0, terms = 0.0, terms_high = 0.0;
    bool certain = true;  // false if a corner might be inverted
    for (const auto& corner : Type::corners) {
        const int origin = corner[0];
        Square<d> j;
        double product = 1.0, longer = 1.0, slack = 0.0;  // Π |J_i|, Π (|J_i| + δ_i), Σ δ_i²
        for (int a = 0; a < d; ++a) {
            const int end = corner[a + 1];
            double before = 0.0, after = 0.0;
            for (int i = 0; i < d; ++i) {
                const double edge = points[Index{nodes[end]} * d + i] - points[Index{nodes[origin]} * d + i];
                j[i][a] = edge + moved[end][i] - moved[origin][i];
                before += edge * edge;
                after += j[i][a] * j[i][a];
            }
            const double delta = epsilon * std::sqrt(before), length = std::sqrt(after);
            product *= length;
            longer *= length + delta;
            slack += delta * delta;
        }
        const double det = determinant<d>(j), off = longer - product;
        total += det;
        low += det - off;
        high += det + off;
        terms += shape_term<Type>(j, product, 0.0, std::abs(det));
        certain = certain && det - off > 0.0;
        if (certain) terms_high += shape_term<Type>(j, longer, std::sqrt(slack), det - off);
    }
    const double tau = total / reference, size = std::min(std::abs(tau), 1.0 / std::abs(tau));
    modelled = {tau > 0.0 ? size : -size, n / terms};
    if (certain) least = {rounding * std::min(low / reference, reference / high), rounding * n / terms_high};
}

}  // namespace

void bounded_quality(Matrix<const double> points, Matrix<const Node> nodes, Vector<const double> reference,
                     Vector<const Index> group, Matrix<const double> middles, Cube<const double> coefficients,
                     Vector<const double> remainder, Matrix<double> modelled, Matrix<double> least) {
    const Index m = nodes.shape(0), groups = remainder.size(), dimension = points.shape(1);
    require_below(nodes, points.shape(0), "nodes: expected numbers of points");
    require_below(group, groups, "group: expected numbers of groups");
    require(reference.size() == m && group.size() == m, "reference, group: expected one entry for each cell");
    require(modelled.shape() == std::array{Index{2}, m} && least.shape() == modelled.shape(),
            "modelled, least: expected the shape (2, m)");
    require(middles.shape() == std::array{groups, dimension}, "middles: expected the shape (groups, d)");
    with_cell_type(dimension, nodes.shape(1), [&]<class Type>(Type) {
        require(coefficients.shape() == std::array{groups, dimension, terms_of(Type::dimension)},
                "coefficients: expected those of a cubic polynomial for each group and dimension");
        for_ranges(m, block, [&](Index first, Index last) {
            for (Index e = first; e < last; ++e) {
                const Index g = group[e];
                std::array<double, 2> own{std::nan(""), std::nan("")}, bounds{-infinity, -infinity};
                if (remainder[g] < infinity)
                    bound<Type>(points.data(), nodes.data() + e * Type::nodes, reference[e],
                                middles.data() + g * dimension, coefficients[g].data(), remainder[g], own, bounds);
                for (int row = 0; row < 2; ++row) modelled(row, e) = own[row], least(row, e) = bounds[row];
            }
        });
    });
}

}  // namespace mesh_motion
