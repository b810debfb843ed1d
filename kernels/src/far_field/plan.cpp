#include "far_field/plan.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace mesh_motion {
namespace {

constexpr int first_order = 2;

using Corner = std::array<double, 3>;

struct Box {
    Corner low, high;

    Box(Matrix<const double> lower, Matrix<const double> upper, Index b)
        : low{lower(b, 0), lower(b, 1), lower(b, 2)}, high{upper(b, 0), upper(b, 1), upper(b, 2)} {}

    double extent() const { return std::max({high[0] - low[0], high[1] - low[1], high[2] - low[2]}); }

    /// Least and largest distance between its points and another's.
    std::array<double, 2> separation(const Box& other) const {
        double near = 0.0, far = 0.0;
        for (int m = 0; m < 3; ++m) {
            const double gap = std::max({other.low[m] - high[m], low[m] - other.high[m], 0.0});
            const double reach = std::max(other.high[m] - low[m], high[m] - other.low[m]);
            near += gap * gap;
            far += reach * reach;
        }
        return {std::sqrt(near), std::sqrt(far)};
    }

    /// By order p: Σ_m Λ_p^(m−1) 2 (a_m/2)^p with half sides a_m, the longest first.
    void factors(Vector<const double> lebesgue, std::vector<double>& out) const {
        Corner halves;
        for (int m = 0; m < 3; ++m) halves[m] = 0.5 * (high[m] - low[m]);
        std::sort(halves.begin(), halves.end(), std::greater<>());
        Corner powers{0.5 * halves[0], 0.5 * halves[1], 0.5 * halves[2]};
        for (Index order = first_order; order < lebesgue.size(); ++order) {
            double amplified = 1.0;
            out[order] = 0.0;
            for (int m = 0; m < 3; ++m) {
                powers[m] *= 0.5 * halves[m];
                out[order] += amplified * 2.0 * powers[m];
                amplified *= lebesgue[order];
            }
        }
    }
};

void check_pairs(Matrix<const Index> pairs, Index n, Index most, const char* expected) {
    require(pairs.shape(0) == n && pairs.shape(1) == 2, expected);
    for (Index i = 0; i < n; ++i)
        require(0 <= pairs(i, 0) && pairs(i, 0) <= pairs(i, 1) && pairs(i, 1) <= most, expected);
}

void check_corners(Matrix<const double> low, Matrix<const double> high, Index n) {
    require(n > 0 && low.shape(0) == n && low.shape(1) == 3 && high.shape() == low.shape(),
            "low, high: expected (b, 3) of at least one box");
}

Owned<Index, 2> entries_of(std::vector<Index> entries) {
    const auto n = static_cast<Index>(entries.size()) / 4;
    return {std::move(entries), {n, 4}};
}

}  // namespace

std::tuple<Owned<Index, 2>, Owned<Index, 2>, Owned<double, 1>> plan_far_field(
    Matrix<const double> low, Matrix<const double> high, Vector<const Index> parent, Matrix<const Index> points_of,
    Matrix<const Index> children_of, Matrix<const double> other_low, Matrix<const double> other_high,
    Matrix<const Index> centres_of, Matrix<const Index> parts_of, Vector<const double> weight,
    Matrix<const double> table, Vector<const double> distances, double reach, int across,
    Vector<const double> lebesgue, double tolerance, int d, int highest, double share) {
    const Index n = parent.size(), others = weight.size();
    check_corners(low, high, n);
    check_corners(other_low, other_high, others);
    check_pairs(points_of, n, std::numeric_limits<Index>::max(), "points_of: expected (b, 2), first and last");
    check_pairs(children_of, n, n, "children_of: expected (b, 2) numbers of boxes");
    check_pairs(centres_of, others, std::numeric_limits<Index>::max(), "centres_of: expected (o, 2), first and last");
    check_pairs(parts_of, others, others, "parts_of: expected (o, 2) numbers of boxes");
    for (Index b = 0; b < n; ++b) require(b == 0 || (0 <= parent[b] && parent[b] < b), "parent: expected it before");
    for (Index b = 0; b < others; ++b)
        require(parts_of(b, 0) == parts_of(b, 1) || b < parts_of(b, 0), "parts_of: expected them behind");
    require(table.shape(0) == lebesgue.size() && table.shape(1) == distances.size() + 1,
            "table, distances, lebesgue: expected (orders, 1 + n), (n,), (orders,)");
    require(highest < lebesgue.size() && d <= 3, "highest, d: expected an order of the table, at most 3");

    std::vector<Index> far, near, left{0}, stack;  // left: boxes of centres that a box of points leaves to its children
    std::vector<std::array<Index, 2>> left_of(n);
    std::vector<double> bound(n), factors(lebesgue.size());
    for (Index b = 0; b < n; ++b) {
        const Box box(low, high, b);
        const bool leaf = children_of(b, 0) == children_of(b, 1);
        const auto [begin, end] = b == 0 ? std::array<Index, 2>{0, 1} : left_of[parent[b]];
        bound[b] = b == 0 ? 0.0 : bound[parent[b]];
        box.factors(lebesgue, factors);
        const double affordable = share * static_cast<double>(points_of(b, 1) - points_of(b, 0));
        const auto points_in = [&](int p) { return p * (d > 1 ? p : 1) * (d > 2 ? p : 1); };
        int worthwhile = highest;
        while (worthwhile >= first_order && points_in(worthwhile) > affordable) --worthwhile;
        left_of[b][0] = static_cast<Index>(left.size());
        for (Index i = begin; i < end; ++i) {
            stack.push_back(left[i]);
            while (!stack.empty()) {
                const Index o = stack.back();
                stack.pop_back();
                const Box other(other_low, other_high, o);
                const auto [nearest, furthest] = box.separation(other);
                if (nearest > reach) continue;
                // the lowest order that is good enough
                const int most = furthest > reach ? std::min(worthwhile, across) : worthwhile;
                const Index column = std::upper_bound(distances.begin(), distances.end(), nearest) - distances.begin();
                int order = first_order;
                while (order <= most && !(table(order, column) * factors[order] <= tolerance)) ++order;
                if (order <= most) {
                    far.insert(far.end(), {b, order, centres_of(o, 0), centres_of(o, 1)});
                    bound[b] += table(order, column) * factors[order] * weight[o];
                } else if (parts_of(o, 0) < parts_of(o, 1) && (leaf || other.extent() > box.extent())) {
                    for (Index part = parts_of(o, 0); part < parts_of(o, 1); ++part) stack.push_back(part);
                } else if (leaf) {
                    near.insert(near.end(), {b, 0, centres_of(o, 0), centres_of(o, 1)});
                } else {
                    left.push_back(o);
                }
            }
        }
        left_of[b][1] = static_cast<Index>(left.size());
    }
    return {entries_of(std::move(far)), entries_of(std::move(near)), owned(std::move(bound))};
}

}  // namespace mesh_motion
