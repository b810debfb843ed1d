#include "correction/distortion.h"

#include <limits>
#include <numeric>
#include <tuple>

#include "correction/corner.h"
#include "parallel.h"
#include "quality/angle_law.h"

namespace mesh_motion {
namespace {

constexpr Index values_of_task = 1 << 14, corners_of_task = 1 << 12, blocks_of_task = 1 << 9;
constexpr double no_weight = 1e-12;  // of the mean weight: corners of smaller weight get no gradient
constexpr double infinity = std::numeric_limits<double>::infinity();

/// The corners of a mesh; by_dimension calls f(dimension).
struct Corners {
    Matrix<const double> points;
    Matrix<const std::int32_t> nodes;
    Cube<const double> ideals;
    Vector<const double> angles{};

    void check(Index n) const {
        const Index d = points.shape(1);
        require(nodes.shape(1) == d + 1, "corners: expected shape (c, d + 1)");
        require(ideals.shape() == std::array{nodes.shape(0), d, d}, "ideals: expected shape (c, d, d)");
        require(n == nodes.shape(0), "expected one number a corner");
        require(angles.size() == 0 || angles.size() == n, "angles: expected one number a corner, or none");
    }
    Index size() const { return nodes.shape(0); }

    /// Checks the corners of a task while they are in the cache.
    void check(Index first, Index last) const {
        require_below(nodes.rows(first, last), points.shape(0), "corners: expected numbers of points");
    }

    /// J, P and A of the corners `at`, one in each lane.
    template <int d>
    std::tuple<Small<d>, Small<d>, Small<d>> jacobians(const std::array<Index, lanes>& at) const {
        const Small<d> p = ideals_of<d>(ideals, [&](int l) { return at[l]; });
        const auto node = [&](int l, int place) { return nodes.data()[at[l] * (d + 1) + place]; };
        const Small<d> a = edges<d>(points, node);
        return {product<d>(a, p), p, a};
    }

    /// The obliqueness at rest of those corners; negative if their angles do not count.
    Pack rest_angle(const std::array<Index, lanes>& at) const {
        return angles.size() ? gathered([&](int l) { return angles[at[l]]; }) : all(-1.0);
    }
};

/// The corners c … last − 1 for the lanes; surplus lanes repeat the last corner.
std::array<Index, lanes> from(Index c, Index last) {
    std::array<Index, lanes> at;
    for (Index l = 0; l < lanes; ++l) at[l] = std::min(c + l, last - 1);
    return at;
}

template <int d>
Pack distortion(Pack tau, Pack q, const SizeLaw& law) {
    const Pack shape = d > 1 ? each(logarithm, q / d) : Pack{};
    constexpr double b = d > 1 ? 2.0 / d : 0.0;
    const Mask number = (q > 0.0) & (q < infinity);
    if (law.epsilon == 0.0) {
        const Pack t = each(logarithm, tau);
        const Pack value = shape - b * t + log_cosh(t, law);
        return number & (tau > 0.0) ? value : all(infinity);
    }
    const Pack s = root(tau * tau + law.epsilon * law.epsilon);
    const Pack chi = tau > 0.0 ? 0.5 * (tau + s) : 0.5 * law.epsilon * law.epsilon / (s - tau);
    const Pack value =
        shape - (b + law.a) * each(logarithm, chi) + law.a * each(logarithm, 0.5 * (1.0 + tau * tau));
    return number ? value : all(infinity);
}

/// First and second derivative of the part of ℓ that depends only on τ.
template <int d>
std::pair<Pack, Pack> slopes(Pack tau, const SizeLaw& law) {
    constexpr double b = d > 1 ? 2.0 / d : 0.0;
    if (law.epsilon == 0.0) {
        const auto [first, second] = log_cosh_slopes(each(logarithm, tau), law);
        return {(first - b) / tau, (second + b - first) / (tau * tau)};
    }
    const Pack s = root(tau * tau + law.epsilon * law.epsilon), square = 1.0 + tau * tau;
    return {2.0 * law.a * tau / square - (b + law.a) / s,
            (b + law.a) * tau / (s * s * s) + 2.0 * law.a * (1.0 - tau * tau) / (square * square)};
}

/// |a_k|² of the columns a_k.
template <int d>
std::array<Pack, d> squares(const Small<d>& a) {
    std::array<Pack, d> q{};
    for (int k = 0; k < d; ++k)
        for (int i = 0; i < d; ++i) q[k] += a[i][k] * a[i][k];
    return q;
}

template <int d>
Pack product_of(const std::array<Pack, d>& factors) {
    Pack product = all(1.0);
    for (Pack x : factors) product *= x;
    return product;
}

/// The term of a corner's angles in its distortion (quality/angle_law.h), and its first two derivatives by o.
struct Turned {
    Pack value, first, second;
};

template <int d>
Turned turned(const Small<d>& a, Pack rest) {
    if (!any(rest >= 0.0)) return {Pack{}, Pack{}, Pack{}};
    const Pack lengths = product_of<d>(squares<d>(a)), size = size_of(determinant<d>(a));
    const Pack o = 0.5 * each(logarithm, lengths) - each(logarithm, size) - rest;
    const AngleLaw<Pack> law((rest >= 0.0) & (o > 0.0) ? o : all(0.0));
    return {law.value(), law.first(), law.second()};
}

/// The gradient of the obliqueness at the edges (columns of A); 0 if φ' is 0 in all lanes, so that no angles count.
template <int d>
Small<d> obliqueness_slope(const Small<d>& j, const Small<d>& p, const Small<d>& a, Pack tau, Pack angle) {
    if (!any(angle > 0.0)) return {};
    Small<d> pull = cofactor<d>(j);
    for (int i = 0; i < d; ++i)
        for (int k = 0; k < d; ++k) pull[i][k] *= -1.0 / tau;
    pull = product_transposed<d>(pull, p);
    const auto q = squares<d>(a);
    for (int i = 0; i < d; ++i)
        for (int k = 0; k < d; ++k) pull[i][k] += a[i][k] / q[k];
    return pull;
}

/// The gradient of ℓ at the edges, from its derivative h1 by τ, the derivative of φ by o, and the gradient of o.
template <int d>
Small<d> slope(const Small<d>& j, const Small<d>& p, Pack h1, Pack angle, const Small<d>& tilt) {
    const Small<d> cof = cofactor<d>(j);
    const Pack twice = 2.0 * inverse_square<d>(j);
    Small<d> pull;
    for (int i = 0; i < d; ++i)
        for (int k = 0; k < d; ++k) pull[i][k] = twice * j[i][k] + h1 * cof[i][k];
    pull = product_transposed<d>(pull, p);
    for (int i = 0; i < d; ++i)
        for (int k = 0; k < d; ++k) pull[i][k] += angle * tilt[i][k];
    return pull;
}

}  // namespace

void corner_maps(Matrix<const double> reference, Matrix<const std::int32_t> corners, double least, Cube<double> ideals,
                 Vector<double> oblique) {
    const Index n = reference.shape(0), d_ = reference.shape(1);
    require(corners.shape(1) == d_ + 1, "corners: expected shape (c, d + 1)");
    require(ideals.shape() == std::array{corners.shape(0), d_, d_}, "ideals: expected shape (c, d, d)");
    require(oblique.size() == corners.shape(0), "oblique: expected one number a corner");
    with_dimension(d_, [&](auto dimension) {
        constexpr int d = dimension;
        for_ranges(corners.shape(0), corners_of_task, [&](Index first, Index last) {
            require_below(corners.rows(first, last), n, "corners: expected numbers of points");
            for (Index c = first; c < last; c += lanes) {
                const auto at = from(c, last);
                const auto node = [&](int l, int place) { return corners.data()[at[l] * (d + 1) + place]; };
                const Small<d> a = edges<d>(reference, node);
                const Small<d> cof = cofactor<d>(a);
                const Pack det = determinant<d>(a), lengths = root(product_of<d>(squares<d>(a)));
                const Mask known = det > least * lengths;
                const Pack o = larger(each(logarithm, known ? lengths / det : all(1.0)), Pack{});
                for (Index l = 0; l < std::min(lanes, last - c); ++l) {
                    oblique[c + l] = known[l] ? o[l] : -1.0;
                    if (!known[l]) continue;
                    for (int i = 0; i < d; ++i)
                        for (int k = 0; k < d; ++k) ideals(c + l, i, k) = cof[k][i][l] / det[l];
                }
            }
        });
    });
}

void distortions(Matrix<const double> points, Matrix<const std::int32_t> corners, Cube<const double> ideals,
                 Vector<const double> angles, Vector<const double> offset, double m, double epsilon, double a,
                 Vector<double> values) {
    const Corners mesh{points, corners, ideals, angles};
    mesh.check(values.size());
    require(offset.size() == 0 || offset.size() == values.size(), "offset: expected one number a corner, or none");
    with_dimension(points.shape(1), [&](auto dimension) {
        constexpr int d = dimension;
        for_ranges(mesh.size(), corners_of_task, [&](Index first, Index last) {
            mesh.check(first, last);
            for (Index c = first; c < last; c += lanes) {
                const auto at = from(c, last);
                const auto [j, p, edges] = mesh.jacobians<d>(at);
                const Pack tau = determinant<d>(j), rest = mesh.rest_angle(at);
                Pack value = distortion<d>(tau, square<d>(j), {m, epsilon, a});
                value += turned<d>(edges, rest).value;
                for (Index l = 0; l < std::min(lanes, last - c); ++l)
                    values[c + l] = offset.size() ? value[l] + offset[c + l] : value[l];
            }
        });
    });
}

double p_mean(Vector<double> values, double p) {
    const Index n = values.size();
    require(n > 0, "values: expected some");
    std::vector<double> parts((n + values_of_task - 1) / values_of_task);
    for_ranges(n, values_of_task, [&](Index first, Index last) {
        double top = -infinity;
        for (Index c = first; c < last; ++c) top = values[c] <= top ? top : values[c] < infinity ? values[c] : infinity;
        parts[first / values_of_task] = top;
    });
    const double highest = *std::max_element(parts.begin(), parts.end());
    if (!(highest < infinity)) return infinity;
    for_ranges(n, values_of_task, [&](Index first, Index last) {
        for (Index c = first; c < last; ++c) values[c] = exponential(p * (values[c] - highest));
        parts[first / values_of_task] = sum_in_lanes(first, last, [&](Index c) { return values[c]; });
    });
    const double total = std::accumulate(parts.begin(), parts.end(), 0.0);
    for_ranges(n, values_of_task, [&](Index first, Index last) {
        for (Index c = first; c < last; ++c) values[c] /= total;
    });
    return highest + logarithm(total / static_cast<double>(n)) / p;
}

void distortion_gradients(Matrix<const double> points, Matrix<const std::int32_t> corners, Cube<const double> ideals,
                          Vector<const double> angles, Vector<const double> weights, double m, double epsilon,
                          double a, Cube<double> shares) {
    const Corners mesh{points, corners, ideals, angles};
    mesh.check(weights.size());
    require(shares.shape() == std::array{mesh.size(), points.shape(1) + 1, points.shape(1)},
            "shares: expected shape (c, d + 1, d)");
    const double least = no_weight / static_cast<double>(mesh.size());
    with_dimension(points.shape(1), [&](auto dimension) {
        constexpr int d = dimension;
        for_ranges(mesh.size(), corners_of_task, [&](Index first, Index last) {
            mesh.check(first, last);
            for (Index c = first; c < last; c += lanes) {
                const auto at = from(c, last);
                const Pack weight = gathered([&](int l) { return weights[at[l]]; });
                std::array<std::array<Pack, d>, d + 1> share{};
                if (any(weight >= least)) {
                    const auto [j, p, edges] = mesh.jacobians<d>(at);
                    const Pack tau = determinant<d>(j), rest = mesh.rest_angle(at);
                    const Pack h1 = slopes<d>(tau, {m, epsilon, a}).first;
                    const Pack angle = turned<d>(edges, rest).first;
                    const auto pull = slope<d>(j, p, h1, angle, obliqueness_slope<d>(j, p, edges, tau, angle));
                    for (int i = 0; i < d; ++i)
                        for (int k = 0; k < d; ++k) {
                            const Pack x = weight >= least ? weight * pull[i][k] : all(0.0);
                            share[k + 1][i] = x;
                            share[0][i] -= x;
                        }
                }
                for (Index l = 0; l < std::min(lanes, last - c); ++l)
                    for (int k = 0; k <= d; ++k)
                        for (int i = 0; i < d; ++i) shares(c + l, k, i) = share[k][i][l];
            }
        });
    });
}

void determinants(Matrix<const double> points, Matrix<const std::int32_t> corners, Cube<const double> ideals,
                  Vector<double> taus) {
    const Corners mesh{points, corners, ideals};
    mesh.check(taus.size());
    with_dimension(points.shape(1), [&](auto dimension) {
        constexpr int d = dimension;
        for_ranges(mesh.size(), corners_of_task, [&](Index first, Index last) {
            mesh.check(first, last);
            for (Index c = first; c < last; c += lanes) {
                const Pack tau = determinant<d>(std::get<0>(mesh.jacobians<d>(from(c, last))));
                for (Index l = 0; l < std::min(lanes, last - c); ++l) taus[c + l] = tau[l];
            }
        });
    });
}

void corner_hessians(Matrix<const double> points, Matrix<const std::int32_t> corners, Cube<const double> ideals,
                     Vector<const double> angles, Vector<const double> first, Vector<const double> second, double m,
                     double a, bool exact, Cube<double> blocks) {
    const Corners mesh{points, corners, ideals, angles};
    mesh.check(first.size());
    mesh.check(second.size());
    const Index size = points.shape(1) * points.shape(1);
    require(blocks.shape() == std::array{mesh.size(), size, size}, "blocks: expected shape (c, d², d²)");
    with_dimension(points.shape(1), [&](auto dimension) {
        constexpr int d = dimension;
        for_ranges(mesh.size(), blocks_of_task, [&](Index begin, Index end) {
            mesh.check(begin, end);
            for (Index c = begin; c < end; c += lanes) {
                const auto at = from(c, end);
                const auto [j, ideal, edges] = mesh.jacobians<d>(at);
                const Pack tau = determinant<d>(j), rest = mesh.rest_angle(at);
                const Turned oblique = turned<d>(edges, rest);
                const Pack angle = oblique.first;
                const auto [h1, h2] = slopes<d>(tau, {m, 0.0, a});
                const Pack weight = gathered([&](int l) { return first[at[l]]; });
                const Pack bend = gathered([&](int l) { return second[at[l]]; });
                const Terms terms{all(1.0), h1 - angle / tau, h2 + angle / (tau * tau), Pack{}, h1};
                Curvature<d> total;
                if (exact) curvature<d, true>(j, inverse_square<d>(j), ideal, terms, weight, total);
                else curvature<d>(j, inverse_square<d>(j), ideal, terms, weight, total);
                const auto tilt = obliqueness_slope<d>(j, ideal, edges, tau, angle);
                const auto pull = slope<d>(j, ideal, h1, angle, tilt);
                const auto q = squares<d>(edges);
                for (int r = 0; r < d * d; ++r)
                    for (int s = 0; s <= r; ++s) {
                        const int k = r / d, x = r % d, y = s % d;
                        total[r][s] += bend * pull[x][k] * pull[y][s / d];
                        total[r][s] += weight * oblique.second * tilt[x][k] * tilt[y][s / d];
                        if (k != s / d) continue;  // log |a_k|
                        const Pack along = (exact ? 2.0 : 1.0) * edges[x][k] * edges[y][k] / q[k];
                        total[r][s] += weight * angle * ((x == y ? 1.0 : 0.0) - along) / q[k];
                    }
                for (Index l = 0; l < std::min(lanes, end - c); ++l) {
                    double* block = &blocks(c + l, 0, 0);
                    for (int r = 0; r < d * d; ++r)
                        for (int s = 0; s <= r; ++s) {
                            const int edges = r / d * d + s / d, mirrored = s / d * d + r / d;
                            block[edges * d * d + r % d * d + s % d] = block[mirrored * d * d + s % d * d + r % d] =
                                total[r][s][l];
                        }
                }
            }
        });
    });
}

void corner_blocks(Matrix<const double> points, Matrix<const std::int32_t> corners, Cube<const double> ideals,
                   Vector<const double> weights, double floor, double least_weight, double p, double m, double epsilon,
                   double a, Cube<float> blocks) {
    const Corners mesh{points, corners, ideals};
    mesh.check(weights.size());
    const Index size = points.shape(1) * points.shape(1);
    require(blocks.shape() == std::array{mesh.size(), size, size}, "blocks: expected shape (c, d², d²)");
    with_dimension(points.shape(1), [&](auto dimension) {
        constexpr int d = dimension;
        for_ranges(mesh.size(), blocks_of_task, [&](Index first, Index last) {
            mesh.check(first, last);
            std::array<Index, lanes> at{};
            Index count = 0;
            const auto update = [&] {  // the corners `at`; surplus lanes repeat the last one
                for (Index l = count; l < lanes; ++l) at[l] = at[count - 1];
                const auto [j, ideal, edges] = mesh.jacobians<d>(at);
                const Pack tau = determinant<d>(j);
                const auto [h1, h2] = slopes<d>(tau, {m, epsilon, a});
                const Pack weight = gathered([&](int l) { return weights[at[l]]; }) + floor;
                Curvature<d> total;
                curvature<d>(j, inverse_square<d>(j), ideal, {all(1.0), h1, h2, all(p), h1}, weight, total);
                for (Index l = 0; l < count; ++l) {
                    float* block = blocks[at[l]].data();
#pragma GCC unroll 45
                    for (int r = 0; r < d * d; ++r)
#pragma GCC unroll 45
                        for (int s = 0; s <= r; ++s) {
                            const int edges = r / d * d + s / d, mirrored = s / d * d + r / d;
                            block[edges * d * d + r % d * d + s % d] = block[mirrored * d * d + s % d * d + r % d] =
                                static_cast<float>(total[r][s][l]);
                        }
                }
                count = 0;
            };
            for (Index c = first; c < last; ++c) {
                if (weights[c] < least_weight) continue;
                at[count++] = c;
                if (count == lanes) update();
            }
            if (count) update();
        });
    });
}

}  // namespace mesh_motion
