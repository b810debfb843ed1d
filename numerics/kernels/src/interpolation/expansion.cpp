#include "interpolation/expansion.h"

#include "interpolation/summation.h"
#include "parallel.h"

namespace mesh_motion {
namespace {

/// Number of centres in a tile; their derivatives (19 in three dimensions) stay in the first-level cache.
constexpr Index few = 128;
/// Closer to a centre than this share of R, all odd derivatives are zero, because the functions are even.
constexpr double at_centre = 1e-9;

/// Monomials of degree 1 to 3.
template <int D>
inline constexpr std::size_t terms = D == 1 ? 3 : D == 2 ? 9 : 19;

/// The derivatives of φ for every centre of a tile, one row for each monomial. N is the degree of ξ^(2k) ψ_k.
template <int D, int N>
void fill_derivatives(const Point& x, Index first, Index last, Matrix<const double> centres, double inverse_radius,
                      Matrix<const double> derivatives, std::array<std::array<double, few>, terms<D>>& tile) {
    double c[3][N + 1];
    for (Index k = 0; k < 3; ++k)
        for (Index n = 0; n <= N; ++n) c[k][n] = derivatives(k, n);
    const double inverse2 = inverse_radius * inverse_radius, inverse4 = inverse2 * inverse2;
    double one[few], two[few], three[few], along[D][few];
    const Index count = last - first;
    for (int a = 0; a < D; ++a)
        for (Index j = 0; j < count; ++j) along[a][j] = x[static_cast<std::size_t>(a)] - centres(a, first + j);
    for (Index j = 0; j < count; ++j) {
        double square = 0.0;
        for (int a = 0; a < D; ++a) square += along[a][j] * along[a][j];
        const double s = square * inverse2, xi = std::sqrt(s);
        double psi[3];
        for (int k = 0; k < 3; ++k) {
            psi[k] = c[k][N];
            for (int n = N - 1; n >= 0; --n) psi[k] = psi[k] * xi + c[k][n];
        }
        const double within = xi < 1.0 ? 1.0 : 0.0, away = xi > at_centre ? within : 0.0;
        const double per = 1.0 / std::max(s, at_centre * at_centre);
        const double first_order = psi[0] * per * within;
        one[j] = (xi > at_centre ? first_order : c[0][2]) * inverse2;
        two[j] = psi[1] * per * per * inverse4 * away;
        three[j] = psi[2] * per * per * per * inverse4 * inverse2 * away;
    }
    std::size_t row = 0;
    const auto fill = [&](auto&& entry) {
        auto& into = tile[row++];
        for (Index j = 0; j < count; ++j) into[static_cast<std::size_t>(j)] = entry(j);
    };
    for (int a = 0; a < D; ++a) fill([&](Index j) { return one[j] * along[a][j]; });
    for (int a = 0; a < D; ++a)
        for (int b = a; b < D; ++b) {
            const double same = a == b ? 1.0 : 0.0;
            fill([&](Index j) { return two[j] * along[a][j] * along[b][j] + same * one[j]; });
        }
    for (int a = 0; a < D; ++a)
        for (int b = a; b < D; ++b)
            for (int d = b; d < D; ++d) {
                const double ab = a == b ? 1.0 : 0.0, bd = b == d ? 1.0 : 0.0, ad = a == d ? 1.0 : 0.0;
                fill([&](Index j) {
                    return three[j] * along[a][j] * along[b][j] * along[d][j] +
                           two[j] * (ab * along[d][j] + bd * along[a][j] + ad * along[b][j]);
                });
            }
}

/// Calls f(N) for the degrees of Wendland's functions.
template <class F>
void with_degree(Index degree, F&& f) {
    switch (degree) {
        case 5: return f(std::integral_constant<int, 5>{});    // C2
        case 8: return f(std::integral_constant<int, 8>{});    // C4
        case 11: return f(std::integral_constant<int, 11>{});  // C6
        default: throw std::invalid_argument("derivatives: expected those of Wendland's C2, C4 or C6");
    }
}

}  // namespace

void expand(Matrix<const double> points, Matrix<const double> centres, Matrix<const double> weights,
            double inverse_radius, Matrix<const double> derivatives, Vector<const double> origin, double inverse_side,
            Vector<const Index> shape, Vector<const Index> starts, Cube<double> out) {
    require(points.shape(1) == 3 && centres.shape(0) == 3, "points, centres: expected shapes (n, 3) and (3, nc)");
    require(weights.shape(1) == centres.shape(1), "weights: expected a column for each centre");
    require(derivatives.shape(0) == 3, "derivatives: expected three rows");
    require(out.shape(0) == points.shape(0) && out.shape(1) == weights.shape(0), "out: expected shape (n, k, c)");
    const CentreGrid grid(origin, inverse_side, shape, starts, centres.shape(1));
    const Index d = out.shape(2) == 3 ? 1 : out.shape(2) == 9 ? 2 : 3;
    require(d < 3 || out.shape(2) == 19, "out: expected 3, 9 or 19 derivatives");
    const auto block = static_cast<Index>(1.0 + 1e4 / (grid.visited() + 8.0));
    with_dimension(d, [&](auto dimension) {
        with_degree(derivatives.shape(1) - 1, [&](auto degree) {
            for_ranges(points.shape(0), block, [&](Index begin, Index end) {
                std::array<std::array<double, few>, terms<dimension>> tile;
                std::fill(out.rows(begin, end).begin(), out.rows(begin, end).end(), 0.0);
                for (Index i = begin; i < end; ++i) {
                    const Point x = point_of(points, i);
                    for (const auto& run : grid.centre_runs(x))
                        for (Index first = run.first; first < run.last; first += few) {
                            const Index last = std::min(first + few, run.last);
                            fill_derivatives<dimension, degree>(x, first, last, centres, inverse_radius, derivatives,
                                                                tile);
                            for (Index k = 0; k < weights.shape(0); ++k) {
                                const double* w = weights[k].data() + first;
                                double* sums = out[i][k].data();
                                for (std::size_t c = 0; c < terms<dimension>; ++c) {
                                    const double* row = tile[c].data();
                                    sums[c] += sum_in_lanes(0, last - first, [&](Index j) { return row[j] * w[j]; });
                                }
                            }
                        }
                }
            });
        });
    });
}

void sum_remainders(Matrix<const double> middles, Vector<const double> radii, Matrix<const double> places,
                    Vector<const double> reaches, Vector<const double> weights, Matrix<const double> table,
                    double inverse_radius, double near, Vector<double> out) {
    const Index groups = out.size(), clusters = weights.size(), steps = table.shape(1) - 1;
    require(middles.shape(0) == groups && radii.size() == groups, "middles, radii: expected a ball for each of out");
    require(places.shape(0) == clusters && reaches.size() == clusters, "places, reaches: expected one for each weight");
    require(table.shape(0) == 2 && steps >= 1, "table: expected two rows");
    require(places.shape(1) == middles.shape(1), "places: expected as many coordinates as of middles");
    with_dimension(middles.shape(1), [&](auto d) {
        for_ranges(groups, 1 + (1 << 16) / (clusters + 1), [&](Index first, Index last) {
            for (Index g = first; g < last; ++g) {
                const double rho = radii[g], small = rho * inverse_radius;
                const double by_third = small * small * inverse_radius;
                const double by_fourth = small * small * small / 6.0 * inverse_radius;
                double total = 0.0;
                for (Index k = 0; k < clusters; ++k) {
                    double square = 0.0;
                    for (Index a = 0; a < d; ++a) {
                        const double away = middles(g, a) - places(k, a);
                        square += away * away;
                    }
                    const double nearest = std::sqrt(square) - reaches[k];
                    const double xi = (nearest - rho) * inverse_radius;
                    if (nearest >= near * rho || !(xi < 1.0)) continue;
                    const auto step = static_cast<Index>(std::max(xi, 0.0) * static_cast<double>(steps));
                    total += weights[k] * std::min(by_third * table(0, step), by_fourth * table(1, step));
                }
                out[g] = total;
            }
        });
    });
}

}  // namespace mesh_motion
