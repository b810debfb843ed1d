#include "far_field/chebyshev.h"

#include "parallel.h"

namespace mesh_motion {
namespace {

constexpr Index boxes = 8;  // of one task

/// The positive places of each order, to the last bit: cosines differ between machines.
constexpr double half_of[most_order + 1][most_order / 2] = {
    {},
    {},
    {0.7071067811865476},
    {0.8660254037844386},
    {0.9238795325112867, 0.3826834323650898},
    {0.9510565162951535, 0.5877852522924731},
    {0.9659258262890683, 0.7071067811865476, 0.25881904510252074},
    {0.9749279121818236, 0.7818314824680298, 0.4338837391175581},
    {0.9807852804032304, 0.8314696123025452, 0.5555702330196022, 0.19509032201612828},
    {0.984807753012208, 0.8660254037844386, 0.6427876096865394, 0.3420201433256687},
    {0.9876883405951378, 0.8910065241883679, 0.7071067811865476, 0.4539904997395468, 0.15643446504023087},
};

constexpr double place_of(int order, int i) {
    return 2 * i + 1 < order ? half_of[order][i] : 2 * i + 1 == order ? 0.0 : -half_of[order][order - 1 - i];
}

struct Tables {
    /// [p][m][i]: Lagrange function i of order p is Σ_m [p, m, i] T_m, by discrete orthogonality.
    double coefficients[most_order + 1][most_order][most_order] = {};
    /// [q][p]: from the points of order p to those of order q ≥ p.
    Resampling higher[most_order + 1][most_order + 1] = {};

    Tables() {
        for (int p = 1; p <= most_order; ++p)
            for (int i = 0; i < p; ++i) {
                double before = place_of(p, i), now = 1.0;  // T_−1 = T_1
                for (int m = 0; m < p; ++m) {
                    coefficients[p][m][i] = (m > 0 ? 2.0 : 1.0) / p * now;
                    before = std::exchange(now, 2.0 * place_of(p, i) * now - before);
                }
            }
        for (int q = 1; q <= most_order; ++q)
            for (int p = 1; p <= q; ++p)
                for (int j = 0; j < q; ++j) {
                    std::array<double, most_order> functions;
                    fill(place_of(q, j), p, functions);
                    for (int i = 0; i < p; ++i) higher[q][p][i][j] = functions[i];
                }
    }

    void fill(double u, int order, std::array<double, most_order>& out) const {
        const auto& rows = coefficients[order];
        std::copy(rows[0], rows[0] + most_order, out.begin());
        double before = 1.0, now = u;
        for (int m = 1; m < order; ++m) {
            for (int i = 0; i < most_order; ++i) out[i] += rows[m][i] * now;
            before = std::exchange(now, 2.0 * u * now - before);
        }
    }
};

const Tables& tables() {
    static const Tables made;
    return made;
}

Index power(Index base, int exponent) { return exponent == 0 ? 1 : base * power(base, exponent - 1); }

/// Middle and half of a side; half of a side without length is 1, so that its points are at 0.
struct Side {
    double middle, half;
    bool flat;

    Side(double low, double high) : middle(0.5 * (low + high)), half(0.5 * (high - low)), flat(!(half > 0.0)) {
        if (flat) half = 1.0;
    }
    double at(double u) const { return flat ? middle : middle + half * u; }
};

/// Numbers of polynomials: ascending from 0 to the number of rows, order^d times k each, no order too high.
void check_starts(Vector<const Index> order, Vector<const Index> starts, int d, Index k, Index rows) {
    require(starts.size() == order.size() + 1 && starts[0] == 0 && starts[order.size()] == rows,
            "starts: expected one more than orders, from 0 to the number of values");
    for (Index b = 0; b < order.size(); ++b)
        require(0 <= order[b] && order[b] <= most_order && starts[b + 1] - starts[b] == power(order[b], d) * k,
                "starts: expected order^d values of each polynomial");
}

void check_range(Vector<const Index> numbers, Index first, Index last, const char* expected) {
    for (Index number : numbers) require(first <= number && number < last, expected);
}

void check_corners(Matrix<const double> low, Matrix<const double> high, Index n) {
    require(low.shape() == high.shape() && low.shape(0) == n && low.shape(1) == 3, "low, high: expected (b, 3)");
}

/// out (k) += the polynomial with values (p^D, k) at one place, by the Lagrange functions there of each axis.
template <int D>
void add_value(const double* values, int p, const std::array<double, most_order>* weights, Index k,
               double* __restrict out, double* __restrict room) {
    if constexpr (D == 1) {
        for (int i = 0; i < p; ++i)
            for (Index c = 0; c < k; ++c) out[c] += (*weights)[i] * values[i * k + c];
    } else {
        const Index slab = (D == 2 ? p : Index{p} * p) * k;
        std::fill(room, room + slab, 0.0);
        for (int i = 0; i < p; ++i) {
            const double weight = (*weights)[i];
            for (Index r = 0; r < slab; ++r) room[r] += weight * values[i * slab + r];
        }
        add_value<D - 1>(room, p, weights + 1, k, out, room + slab);
    }
}

}  // namespace

double chebyshev_place(int order, int i) { return place_of(order, i); }

void lagrange_functions(double u, int order, std::array<double, most_order>& out) { tables().fill(u, order, out); }

void box_points(Vector<const Index> box, Vector<const Index> order, Vector<const Index> starts, int d,
                Matrix<const double> low, Matrix<const double> high, Matrix<double> out) {
    require(order.size() == box.size() && out.shape(1) == 3, "order, out: expected (g,), (r, 3)");
    require(1 <= d && d <= 3, "d: expected one, two or three dimensions");
    check_starts(order, starts, d, 1, out.shape(0));
    check_corners(low, high, low.shape(0));
    check_range(box, 0, low.shape(0), "box: expected numbers of boxes");
    for_ranges(box.size(), 16 * boxes, [&](Index first, Index last) {
        for (Index g = first; g < last; ++g)
            for (Index m = 0; m < 3; ++m) {
                const Side side(low(box[g], m), high(box[g], m));
                const Index p = order[g], stride = m < d ? power(p, static_cast<int>(d - 1 - m)) : 1;
                for (Index row = starts[g]; row < starts[g + 1]; ++row) {
                    const auto i = static_cast<int>((row - starts[g]) / stride % p);
                    out(row, m) = m < d ? side.at(place_of(static_cast<int>(p), i)) : side.middle;
                }
            }
    });
}

void carry_down(Vector<const Index> levels, Vector<const Index> parent, Matrix<const double> low,
                Matrix<const double> high, Vector<const Index> order, Vector<const Index> starts,
                Vector<const Index> first_group, Vector<const Index> group_order, Vector<const Index> group_start,
                Matrix<const double> group_values, int d, Vector<double> values) {
    const Index n = order.size(), k = group_values.shape(1), groups = group_order.size();
    require(parent.size() == n && first_group.size() == n + 1, "parent, first_group: expected (b,), (b + 1,)");
    require(std::is_sorted(levels.begin(), levels.end()) && std::is_sorted(first_group.begin(), first_group.end()),
            "levels, first_group: expected them ascending");
    check_range(levels, 0, n + 1, "levels: expected numbers of boxes");
    check_range(parent, -1, n, "parent: expected numbers of boxes");
    check_range(first_group, 0, groups + 1, "first_group: expected numbers of groups");
    check_corners(low, high, n);
    check_starts(order, starts, d, k, values.size());
    check_starts(group_order, group_start, d, 1, group_values.shape(0));
    for (Index box = 0; box < n; ++box) {
        Index least = parent[box] < 0 ? 0 : order[parent[box]];
        for (Index g = first_group[box]; g < first_group[box + 1]; ++g) least = std::max(least, group_order[g]);
        require(least <= order[box], "order: expected no less than the parent's and the groups'");
    }
    with_dimension(d, [&](auto dimension) {
        constexpr int D = dimension;
        for (Index level = 0; level + 1 < levels.size(); ++level)
            for_ranges(levels[level + 1] - levels[level], boxes, [&](Index begin, Index end) {
                std::vector<double> room(resampling_room<D>(most_order, k));
                for (Index box = levels[level] + begin; box < levels[level] + end; ++box) {
                    const int q = static_cast<int>(order[box]), sizes[]{q, q, q};
                    if (q == 0) continue;
                    double* own = values.data() + starts[box];
                    std::fill(own, values.data() + starts[box + 1], 0.0);
                    for (Index g = first_group[box]; g < first_group[box + 1]; ++g) {
                        const auto p = static_cast<int>(group_order[g]);
                        const Resampling* matrix = &tables().higher[q][p];
                        const Resampling* const matrices[]{matrix, matrix, matrix};
                        const double* told = group_values.data() + group_start[g] * k;
                        add_resampled<D>(told, p, matrices, sizes, k, own, room.data());
                    }
                    const Index above = parent[box];
                    if (above < 0 || order[above] == 0) continue;
                    const auto p = static_cast<int>(order[above]);
                    std::array<Resampling, D> matrix;
                    const Resampling* matrices[D];
                    for (int m = 0; m < D; ++m) {
                        const Side wide(low(above, m), high(above, m)), narrow(low(box, m), high(box, m));
                        for (int x = 0; x < q; ++x) {
                            std::array<double, most_order> functions;
                            lagrange_functions((narrow.at(place_of(q, x)) - wide.middle) / wide.half, p, functions);
                            for (int i = 0; i < p; ++i) matrix[m][i][x] = functions[i];
                        }
                        matrices[m] = &matrix[m];
                    }
                    add_resampled<D>(values.data() + starts[above], p, matrices, sizes, k, own, room.data());
                }
            });
    });
}

void add_polynomials(Vector<const Index> leaves, Matrix<const Index> points_of, Matrix<const double> points,
                     Matrix<const double> low, Matrix<const double> high, Vector<const Index> order,
                     Vector<const Index> starts, Vector<const double> values, int d, Matrix<double> out) {
    const Index n = order.size(), k = out.shape(1);
    require(points_of.shape(0) == n && points_of.shape(1) == 2, "points_of: expected (b, 2)");
    require(points.shape(0) == out.shape(0) && points.shape(1) == 3, "points: expected (n, 3)");
    check_corners(low, high, n);
    check_starts(order, starts, d, k, values.size());
    check_range(leaves, 0, n, "leaves: expected numbers of boxes");
    for (Index box : leaves)
        require(0 <= points_of(box, 0) && points_of(box, 1) <= out.shape(0), "points_of: expected numbers of points");
    with_dimension(d, [&](auto dimension) {
        constexpr int D = dimension;
        for_blocks(leaves.size(), [&](Index number) {
            const Index box = leaves[number];
            const auto p = static_cast<int>(order[box]);
            if (p == 0) return;
            std::vector<double> room(resampling_room<D>(p, k));
            std::array<std::array<double, most_order>, D> weights;
            for (Index i = points_of(box, 0); i < points_of(box, 1); ++i) {
                for (int m = 0; m < D; ++m) {
                    const Side side(low(box, m), high(box, m));
                    lagrange_functions((points(i, m) - side.middle) / side.half, p, weights[m]);
                }
                add_value<D>(values.data() + starts[box], p, weights.data(), k, out[i].data(), room.data());
            }
        });
    });
}

}  // namespace mesh_motion
