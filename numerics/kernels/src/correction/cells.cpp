#include "correction/cells.h"

#include <algorithm>
#include <limits>

#include "correction/corner.h"
#include "parallel.h"

namespace mesh_motion {
namespace {

constexpr Index cells_of_task = 1 << 10, blocks_of_task = 1 << 6;
constexpr int most = 8;  // nodes and corners of a cell

/// One corner in each of eight cells.
template <int d>
struct Corner {
    Small<d> j, p;
    Pack alpha, det;
};

/// Sums over all corners of eight cells: f and α of each corner, their mean and τ; τ = 0 outside the barrier.
struct Sums {
    std::array<Pack, most> f, alpha;
    Pack mean, tau;
};

/// The term of a shape in L, and its derivative.
struct Shape {
    Pack value, slope;
};

struct Cells {
    Matrix<const double> points;
    Matrix<const std::int32_t> nodes;
    Matrix<const Index> corners;
    Cube<const double> ideals;
    double sine;
    Vector<const double> references;
    SizeLaw law;
    Vector<const double> offset;
    double p;

    int n_corners() const { return static_cast<int>(corners.shape(0)); }
    Index size() const { return nodes.shape(0); }

    void check(Index n) const {
        const Index d = points.shape(1), k = nodes.shape(1);
        require(d == 2 || d == 3, "points: expected two or three columns");
        require(1 <= corners.shape(0) && corners.shape(0) <= most && k <= most && corners.shape(1) == d + 1,
                "corners: expected shape (c, d + 1) with at most eight corners and nodes a cell");
        require_below(corners, k, "corners: expected numbers of the cell's nodes");
        require((ideals.shape(0) == 1 || ideals.shape(0) == size()) && ideals.shape(1) == d && ideals.shape(2) == d,
                "ideals: expected shape (1 or m, d, d)");
        require(references.size() == size() && n == size(), "expected one number a cell");
        require(offset.size() == 0 || offset.size() == size(), "offset: expected none, or one a cell");
    }

    /// Checks the cells of a task while they are in the cache.
    void check(Index first, Index last) const {
        require_below(nodes.rows(first, last), points.shape(0), "nodes: expected numbers of points");
    }

    /// Calls f(dimension) with the dimension as a constant.
    template <class F>
    void with_type(F&& f) const {
        points.shape(1) == 3 ? f(std::integral_constant<int, 3>{}) : f(std::integral_constant<int, 2>{});
    }

    template <int d>
    Corner<d> corner(const std::array<Index, lanes>& at, int k) const {
        const Index width = nodes.shape(1);
        const Small<d> a = edges<d>(
            points, [&](int l, int place) { return nodes.data()[at[l] * width + corners(k, place)]; });
        if (sine > 0.0) {
            Corner<d> found{a, {}, all(1.0), {}};
            for (int j = 0; j < d; ++j) {
                Pack length{};
                for (int i = 0; i < d; ++i) length += a[i][j] * a[i][j];
                length = root(length);
                found.p[j][j] = 1.0 / length;
                found.alpha *= length;
                for (int i = 0; i < d; ++i) found.j[i][j] *= found.p[j][j];
            }
            found.det = determinant<d>(found.j);
            found.alpha *= found.det;
            return found;
        }
        const Small<d> p = ideals_of<d>(ideals, [&](int l) { return ideals.shape(0) == 1 ? 0 : at[l]; });
        const Small<d> j = product<d>(a, p);
        const Pack det = determinant<d>(j);
        return {j, p, det, det};
    }

    template <int d>
    Sums sums(const std::array<Index, lanes>& at) const {
        Sums found{};
        Mask inside = ~Mask{};
        for (int k = 0; k < n_corners(); ++k) {
            const Corner<d> here = corner<d>(at, k);
            inside &= here.det > 0.0;
            const Pack unit = sine > 0.0 ? here.det / sine : here.det;
            const Pack log_f = each(logarithm, square<d>(here.j) / d) - 2.0 / d * each(logarithm, unit);
            found.f[k] = 1.0 / each(exponential, -log_f);
            found.alpha[k] = here.alpha;
            found.mean += found.f[k];
            found.tau += here.alpha;
        }
        found.mean /= n_corners();
        found.tau /= gathered([&](int l) { return references[at[l]]; });
        inside &= (found.tau > 0.0) & (found.mean < std::numeric_limits<double>::infinity());
        found.tau = inside ? found.tau : all(0.0);
        return found;
    }

    /// The term of the shape in L, and its derivative with respect to log mean f.
    Shape shape(const std::array<Index, lanes>& at, const Sums& sums) const {
        const Pack log_f = each(logarithm, sums.mean);
        if (offset.size() == 0) return {log_f, all(1.0)};
        const Pack lost = log_f + gathered([&](int l) { return offset[at[l]]; });
        const Pack positive = lost > 0.0 ? lost : all(0.0);
        const Pack small = each(exponential, p * (lost > 0.0 ? -lost : lost));
        const Pack value = positive + each(logarithm, 1.0 + small) / p;
        return {value, (lost > 0.0 ? all(1.0) : small) / (1.0 + small)};
    }
};

/// The cells c … last − 1 for the lanes; surplus lanes repeat the last cell.
std::array<Index, lanes> from(Index c, Index last) {
    std::array<Index, lanes> at;
    for (Index l = 0; l < lanes; ++l) at[l] = std::min(c + l, last - 1);
    return at;
}

/// Adds pull Pᵀ to shares (k, d) at the ends of the edges, and subtracts the sum at the corner.
template <int d>
void add_edges(const Small<d>& pull, const Small<d>& p, Vector<const Index> corner,
               std::array<std::array<Pack, d>, most>& shares) {
    const Small<d> at_edges = product_transposed<d>(pull, p);
    for (int i = 0; i < d; ++i)
        for (int j = 0; j < d; ++j) {
            shares[corner[j + 1]][i] += at_edges[i][j];
            shares[corner[0]][i] -= at_edges[i][j];
        }
}

/// The lower half, by nodes, of the symmetric (k d, k d) block of each of eight cells.
template <int d>
using Whole = std::array<std::array<Pack, most * d>, most * d>;

/// Adds a corner's curvature to the block `whole` of the nodes; the part of node 0 is minus the sum of the others.
template <int d>
void add_corner(const Curvature<d>& total, Vector<const Index> corner, Whole<d>& whole) {
    const auto entry = [&](int r, int s) { return r >= s ? total[r][s] : total[s][r]; };
    std::array<std::array<Pack, d * d>, d> sums{};
    for (int i = 0; i < d; ++i)
        for (int s = 0; s < d * d; ++s)
            for (int j = 0; j < d; ++j) sums[i][s] += entry(j * d + i, s);
    for (int a = 0; a <= d; ++a)
        for (int b = 0; b <= d; ++b) {
            if (corner[a] < corner[b]) continue;
            for (int i = 0; i < d; ++i)
                for (int j = 0; j < d; ++j) {
                    Pack& out = whole[corner[a] * d + i][corner[b] * d + j];
                    if (a && b) {
                        out += entry((a - 1) * d + i, (b - 1) * d + j);
                    } else if (a) {
                        out -= sums[j][(a - 1) * d + i];
                    } else if (b) {
                        out -= sums[i][(b - 1) * d + j];
                    } else {
                        for (int c = 0; c < d; ++c) out += sums[i][c * d + j];
                    }
                }
        }
}

}  // namespace

void cell_distortions(Matrix<const double> points, Matrix<const std::int32_t> nodes, Matrix<const Index> corners,
                      Cube<const double> ideals, double sine, Vector<const double> references, double m, double a,
                      Vector<const double> offset, double p, Vector<double> values) {
    const Cells cells{points, nodes, corners, ideals, sine, references, {m, 0.0, a}, offset, p};
    cells.check(values.size());
    cells.with_type([&](auto dimension) {
        for_ranges(cells.size(), cells_of_task, [&](Index first, Index last) {
            cells.check(first, last);
            for (Index c = first; c < last; c += lanes) {
                const auto at = from(c, last);
                const Sums sums = cells.sums<dimension>(at);
                Pack value = cells.shape(at, sums).value + log_cosh(each(logarithm, sums.tau), cells.law);
                value = sums.tau > 0.0 ? value : all(std::numeric_limits<double>::infinity());
                for (Index l = 0; l < std::min(lanes, last - c); ++l) values[c + l] = value[l];
            }
        });
    });
}

void cell_gradients(Matrix<const double> points, Matrix<const std::int32_t> nodes, Matrix<const Index> corners,
                    Cube<const double> ideals, double sine, Vector<const double> references, double m, double a,
                    Vector<const double> offset, double p, Vector<const double> weights, Cube<double> shares) {
    const Cells cells{points, nodes, corners, ideals, sine, references, {m, 0.0, a}, offset, p};
    cells.check(weights.size());
    require(shares.shape() == std::array{cells.size(), nodes.shape(1), points.shape(1)},
            "shares: expected shape (m, k, d)");
    cells.with_type([&](auto dimension) {
        constexpr int d = dimension;
        for_ranges(cells.size(), cells_of_task, [&](Index first, Index last) {
            cells.check(first, last);
            for (Index c = first; c < last; c += lanes) {
                const auto at = from(c, last);
                const Sums sums = cells.sums<d>(at);
                const Pack slope = log_cosh_slopes(each(logarithm, sums.tau), cells.law).first;
                const Pack weight = gathered([&](int l) { return weights[at[l]]; });
                const Pack size = sums.tau * gathered([&](int l) { return references[at[l]]; });
                const Pack seen = cells.shape(at, sums).slope;
                std::array<std::array<Pack, d>, most> share{};
                for (int k = 0; k < cells.n_corners(); ++k) {
                    const Corner<d> here = cells.corner<d>(at, k);
                    const Pack omega = seen * sums.f[k] / (sums.mean * cells.n_corners());
                    const Pack beta = sums.alpha[k] / size;
                    const Pack h1 = weight * (slope * beta - 2.0 / d * omega) / here.det;
                    const Pack twice = 2.0 * weight * omega * inverse_square<d>(here.j);
                    Small<d> pull = cofactor<d>(here.j);
                    for (int i = 0; i < d; ++i)
                        for (int j = 0; j < d; ++j) pull[i][j] = twice * here.j[i][j] + h1 * pull[i][j];
                    add_edges<d>(pull, here.p, corners[k], share);
                }
                for (Index l = 0; l < std::min(lanes, last - c); ++l)
                    for (Index k = 0; k < nodes.shape(1); ++k)
                        for (int i = 0; i < d; ++i) shares(c + l, k, i) = share[k][i][l];
            }
        });
    });
}

void cell_blocks(Matrix<const double> points, Matrix<const std::int32_t> nodes, Matrix<const Index> corners,
                 Cube<const double> ideals, double sine, Vector<const double> references, double m, double a,
                 Vector<const double> offset, double p, Vector<const double> weights, double floor,
                 double least_weight, Cube<float> blocks) {
    const Cells cells{points, nodes, corners, ideals, sine, references, {m, 0.0, a}, offset, p};
    cells.check(weights.size());
    const Index n_nodes = nodes.shape(1), width = n_nodes * points.shape(1);
    require(blocks.shape() == std::array{cells.size(), n_nodes * n_nodes, points.shape(1) * points.shape(1)},
            "blocks: expected shape (m, k², d²)");
    cells.with_type([&](auto dimension) {
        constexpr int d = dimension;
        using Pulls = std::array<std::array<Pack, d>, most>;
        const auto update = [&](std::array<Index, lanes>& at, Index count) {
            for (Index l = count; l < lanes; ++l) at[l] = at[count - 1];
            const Sums sums = cells.sums<d>(at);
            const auto [slope, bend] = log_cosh_slopes(each(logarithm, sums.tau), cells.law);
            const Pack weight = gathered([&](int l) { return weights[at[l]]; }) + floor;
            const Pack size = sums.tau * gathered([&](int l) { return references[at[l]]; });
            Pulls g{}, n{};
            Whole<d> whole;
            for (Index r = 0; r < width; ++r) std::fill_n(whole[r].begin(), width, Pack{});
            for (int k = 0; k < cells.n_corners(); ++k) {
                const Corner<d> here = cells.corner<d>(at, k);
                const Pack omega = sums.f[k] / (sums.mean * cells.n_corners()), beta = sums.alpha[k] / size;
                const Pack per_q = inverse_square<d>(here.j), share = 2.0 / d * omega / here.det;
                Small<d> pull, cof = cofactor<d>(here.j);
                for (int i = 0; i < d; ++i)
                    for (int j = 0; j < d; ++j) {
                        pull[i][j] = 2.0 * omega * per_q * here.j[i][j] - share * cof[i][j];
                        cof[i][j] *= beta / here.det;
                    }
                add_edges<d>(pull, here.p, corners[k], g);
                add_edges<d>(cof, here.p, corners[k], n);
                Curvature<d> total;
                const Terms terms{omega, slope * beta / here.det - share, share / here.det, omega, -2.0 / d / here.det};
                curvature<d>(here.j, per_q, here.p, terms, weight, total);
                add_corner<d>(total, corners[k], whole);
            }
            Small<2> pair{{{all(p - 1.0), p * slope}, {p * slope, p * slope * slope + bend - slope}}};
            project<2>(pair);
            for (Index r = 0; r < width; ++r) {
                const Pack in_g = weight * (pair[0][0] * g[r / d][r % d] + pair[0][1] * n[r / d][r % d]);
                const Pack in_n = weight * (pair[1][0] * g[r / d][r % d] + pair[1][1] * n[r / d][r % d]);
                for (Index s = 0; s <= r; ++s) whole[r][s] += in_g * g[s / d][s % d] + in_n * n[s / d][s % d];
            }
            for (Index l = 0; l < count; ++l) {
                const Matrix<float> block = blocks[at[l]];
                for (Index r = 0; r < width; ++r)
                    for (Index s = 0; s <= r; ++s)
                        block(r / d * n_nodes + s / d, r % d * d + s % d) =
                            block(s / d * n_nodes + r / d, s % d * d + r % d) = static_cast<float>(whole[r][s][l]);
            }
        };
        for_ranges(cells.size(), blocks_of_task, [&](Index first, Index last) {
            cells.check(first, last);
            std::array<Index, lanes> at{};
            Index count = 0;
            for (Index c = first; c < last; ++c) {
                if (weights[c] < least_weight) continue;
                at[count++] = c;
                if (count == lanes) update(at, std::exchange(count, 0));
            }
            if (count) update(at, count);
        });
    });
}

}  // namespace mesh_motion
