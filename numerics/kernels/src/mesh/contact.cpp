#include "mesh/contact.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "cubic.h"
#include "parallel.h"

namespace mesh_motion {
namespace {

constexpr Index blocks_in_group = 32;
constexpr Index together = 64;  // pairs of blocks that are looked at before the limit is lowered
constexpr double rounding = 1e-12;
constexpr double beyond = 1e-6;  // share of a facet or an edge by which a contact may be outside of it
constexpr double never = std::numeric_limits<double>::infinity();
constexpr double facing = 1e-9;  // largest product of normals that may face each other

template <int D>
using Vec = std::array<double, D>;

/// The range of places, at the beginning and at the end of a way; between them its ends move evenly, and contain all
/// places.
template <int D>
struct Range {
    std::array<Vec<D>, 2> low, high;

    Range() {
        for (Vec<D>& corner : low) corner.fill(std::numeric_limits<double>::infinity());
        for (Vec<D>& corner : high) corner.fill(-std::numeric_limits<double>::infinity());
    }
    void add(int end, int axis, double low_of, double high_of) {
        low[end][axis] = std::min(low[end][axis], low_of);
        high[end][axis] = std::max(high[end][axis], high_of);
    }
    void add(const Range& other) {
        for (int end = 0; end < 2; ++end)
            for (int axis = 0; axis < D; ++axis) add(end, axis, other.low[end][axis], other.high[end][axis]);
    }
};

/// Limits the part enter … leave of a way to where a gap that changes evenly is not positive.
void limit(double before, double after, double& enter, double& leave) {
    if (before > 0.0) enter = std::max(enter, after > 0.0 ? 2.0 : before / (before - after));
    else if (after > 0.0) leave = std::min(leave, before / (before - after));
}

/// The part of the way before which two ranges do not meet; ∞ if they do not meet on it.
template <int D>
double meeting(const Range<D>& one, const Range<D>& other) {
    double enter = 0.0, leave = 1.0;
    bool meet = true, apart = false;  // now; all the way along an axis: most pairs need no division
    for (int axis = 0; axis < D; ++axis) {
        const double before = one.low[0][axis] - other.high[0][axis], after = one.low[1][axis] - other.high[1][axis];
        const double back = other.low[0][axis] - one.high[0][axis], later = other.low[1][axis] - one.high[1][axis];
        meet &= (before <= 0.0) & (back <= 0.0);
        apart |= ((before > 0.0) & (after > 0.0)) | ((back > 0.0) & (later > 0.0));
    }
    if (meet) return 0.0;
    if (apart) return never;
    for (int axis = 0; axis < D; ++axis) {
        limit(one.low[0][axis] - other.high[0][axis], one.low[1][axis] - other.high[1][axis], enter, leave);
        limit(other.low[0][axis] - one.high[0][axis], other.low[1][axis] - one.high[1][axis], enter, leave);
        if (enter > leave) return never;
    }
    return enter;
}

template <int D>
struct Block {
    Range<D> places;
    Range<D> normals;  // of its facets on the way; only the first end is used
    bool moving = false;

    void add(const Block& other) {
        places.add(other.places);
        normals.add(other.normals);
        moving |= other.moving;
    }
};

/// The nodes and edges of a block, each once, and their places.
template <int D>
struct Parts {
    std::vector<Node> nodes;
    std::vector<Range<D>> at_nodes;
    std::vector<std::array<Node, 2>> edges;
    std::vector<Range<D>> at_edges;
};

/// The least scalar product of normals in two ranges, or less.
template <int D>
double least_product(const Range<D>& one, const Range<D>& other) {
    double sum = 0.0;
    for (int axis = 0; axis < D; ++axis) {
        const double a = one.low[0][axis], b = one.high[0][axis], c = other.low[0][axis], d = other.high[0][axis];
        sum += std::min({a * c, a * d, b * c, b * d});
    }
    return sum;
}

/// The part of the way before which facets of two blocks do not meet; ∞ if they do not.
template <int D>
double meeting(const Block<D>& one, const Block<D>& other) {
    const bool may = (one.moving || other.moving) && least_product<D>(one.normals, other.normals) <= facing;
    return may ? meeting<D>(one.places, other.places) : never;
}

/// Nodes that go on from points by (points − before) in each step.
template <int D>
struct Way {
    Matrix<const double> points, before;

    Vector3 step(Node node) const {
        Vector3 v{};
        for (int axis = 0; axis < D; ++axis) v[axis] = points(node, axis) - before(node, axis);
        return v;
    }
    Vector3 at(Node node, double steps) const {
        Vector3 x = step(node);
        for (int axis = 0; axis < D; ++axis) x[axis] = points(node, axis) + steps * x[axis];
        return x;
    }
    /// The places now and after a number of steps.
    Range<D> range(Node node, double steps) const {
        Range<D> range;
        const Vector3 there = at(node, steps);
        for (int axis = 0; axis < D; ++axis) {
            range.add(0, axis, points(node, axis), points(node, axis));
            range.add(1, axis, there[axis], there[axis]);
        }
        return range;
    }
    template <std::size_t N>
    Range<D> range(const std::array<Node, N>& nodes, double steps) const {
        Range<D> all;
        for (const Node node : nodes) all.add(range(node, steps));
        return all;
    }
};

Vector3 difference(const Vector3& a, const Vector3& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
double product(const Vector3& a, const Vector3& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
Vector3 cross(const Vector3& a, const Vector3& b) {
    return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

/// Normals of a facet to the inner side, divided by the length that the normal has now. Each normal on the way is a mean of
/// them, as they are the Bernstein coefficients of a polynomial.
template <int D>
std::array<Vector3, D> normals(const Way<D>& way, const std::array<Node, D>& facet, double steps) {
    const auto edge = [&](int k, double s) { return difference(way.at(facet[k], s), way.at(facet[0], s)); };
    const Vector3 a = edge(1, 0.0), b = edge(1, steps);
    std::array<Vector3, D> found;
    if constexpr (D == 2) {
        found = {{{-a[1], a[0], 0.0}, {-b[1], b[0], 0.0}}};
    } else {
        const Vector3 c = edge(2, 0.0), e = edge(2, steps), one = cross(a, e), other = cross(b, c);
        found = {{cross(a, c), {}, cross(b, e)}};
        for (int axis = 0; axis < 3; ++axis) found[1][axis] = 0.5 * (one[axis] + other[axis]);
    }
    const double length = std::sqrt(product(found[0], found[0]));
    for (Vector3& normal : found)
        for (double& part : normal) part = length > 0.0 ? part / length : 0.0;
    return found;
}

/// The shares s of u and t of v so that s u + t v is nearest to a place; NaN if u and v are parallel.
std::array<double, 2> shares(const Vector3& u, const Vector3& v, const Vector3& place) {
    const double uu = product(u, u), uv = product(u, v), vv = product(v, v), det = uu * vv - uv * uv;
    const double of_u = product(u, place), of_v = product(v, place);
    if (det <= rounding * uu * vv) return {std::nan(""), std::nan("")};
    return {(vv * of_u - uv * of_v) / det, (uu * of_v - uv * of_u) / det};
}

/// Steps until the ends of D vectors lie in a plane and there `inside`; each from a node to a node. ∞ beyond `most`, and
/// if they are in a plane now.
template <int D, class Inside>
double until(const Way<D>& way, const std::array<std::array<Node, 2>, D>& vectors, double most, Inside&& inside) {
    std::array<Vector3, D> edges, on;
    double size = 1.0;
    for (int k = 0; k < D; ++k) {
        edges[k] = difference(way.at(vectors[k][1], 0.0), way.at(vectors[k][0], 0.0));
        on[k] = difference(way.step(vectors[k][1]), way.step(vectors[k][0]));
        size *= product(edges[k], edges[k]);
    }
    Cubic p = determinant_along<D>(edges, on);
    if (p[0] * p[0] <= rounding * rounding * size) return never;
    if (p[0] < 0.0)
        for (double& coefficient : p) coefficient = -coefficient;
    if (!may_fall(p, most)) return never;
    return first_root(p, most, [&](double steps) {
        std::array<Vector3, D> there;
        for (int k = 0; k < D; ++k)
            there[k] = difference(way.at(vectors[k][1], steps), way.at(vectors[k][0], steps));
        return inside(there);
    });
}

/// Steps until a node meets a facet.
template <int D>
double until(const Way<D>& way, const std::array<Node, D>& facet, Node node, double most) {
    if constexpr (D == 2) {
        return until<2>(way, {{{facet[0], facet[1]}, {facet[0], node}}}, most, [](const auto& at) {
            const double share = product(at[0], at[1]) / product(at[0], at[0]);
            return share >= -beyond && share <= 1.0 + beyond;
        });
    } else {
        return until<3>(way, {{{facet[0], facet[1]}, {facet[0], facet[2]}, {facet[0], node}}}, most, [](const auto& at) {
            const auto [s, t] = shares(at[0], at[1], at[2]);
            return s >= -beyond && t >= -beyond && s + t <= 1.0 + beyond;
        });
    }
}

/// Steps until two edges meet.
double until(const Way<3>& way, const std::array<Node, 2>& one, const std::array<Node, 2>& other, double most) {
    return until<3>(way, {{one, {other[1], other[0]}, {one[0], other[0]}}}, most, [](const auto& at) {
        const auto [s, t] = shares(at[0], at[1], at[2]);
        return s >= -beyond && s <= 1.0 + beyond && t >= -beyond && t <= 1.0 + beyond;
    });
}

template <int D>
class Boundary {
  public:
    Boundary(const Way<D>& way, Matrix<const Node> facets, Vector<const Index> starts, Vector<const bool> moving,
             double most)
        : way_(way), most_(most), facets_(facets.shape(0)), places_(facets.shape(0)),
          starts_(starts.begin(), starts.end()), blocks_(starts_.size()), parts_(starts_.size()) {
        for_blocks(static_cast<Index>(blocks_.size()), [&](Index b) {
            Block<D>& block = blocks_[b];
            for (Index f = starts_[b]; f < end(b); ++f) {
                std::copy(facets[f].begin(), facets[f].end(), facets_[f].begin());
                places_[f] = way.range(facets_[f], most);
                block.places.add(places_[f]);
                for (const Vector3& normal : normals<D>(way, facets_[f], most))
                    for (int axis = 0; axis < D; ++axis) block.normals.add(0, axis, normal[axis], normal[axis]);
                block.moving |= moving[f];
            }
        });
    }

    double first_contact() {
        struct Pair {
            double enter;
            Index one, other;
            auto operator<=>(const Pair&) const = default;
        };
        const Index count = static_cast<Index>(blocks_.size());
        std::vector<Block<D>> groups((count + blocks_in_group - 1) / blocks_in_group);
        for (Index b = 0; b < count; ++b) groups[b / blocks_in_group].add(blocks_[b]);
        std::vector<std::vector<Pair>> of_block(count);
        for_blocks(count, [&](Index b) {
            std::vector<Pair> own;
            for (Index g = b / blocks_in_group; g < static_cast<Index>(groups.size()); ++g) {
                if (meeting<D>(groups[g], blocks_[b]) > 1.0) continue;
                const Index first = g * blocks_in_group;
                for (Index other = std::max(b, first); other < std::min(count, first + blocks_in_group); ++other)
                    if (const double enter = meeting<D>(blocks_[other], blocks_[b]); enter <= 1.0)
                        own.push_back({enter, b, other});
            }
            of_block[b] = std::move(own);
        });
        std::vector<Pair> pairs;
        for (const auto& own : of_block) pairs.insert(pairs.end(), own.begin(), own.end());
        std::sort(pairs.begin(), pairs.end());
        double best = never;  // of a fixed number of pairs together, so that it does not depend on the threads
        for (std::size_t first = 0; first < pairs.size() && pairs[first].enter * most_ < best; first += together) {
            std::array<double, together> found;
            found.fill(best);
            const Index number = std::min<Index>(together, static_cast<Index>(pairs.size() - first));
            std::vector<Index> entered;  // most blocks never enter another one: only these are taken apart
            for (Index k = 0; k < number; ++k)
                for (const Index b : {pairs[first + k].one, pairs[first + k].other})
                    if (parts_[b].nodes.empty()) entered.push_back(b);
            unique(entered);
            for_blocks(static_cast<Index>(entered.size()), [&](Index k) { parts_[entered[k]] = parts(entered[k]); });
            for_blocks(number, [&](Index k) {
                const Pair& pair = pairs[first + k];
                double least = found[k];
                nodes_at_facets(pair.one, pair.other, least);
                if (pair.one != pair.other) nodes_at_facets(pair.other, pair.one, least);
                if constexpr (D == 3) edges_at_edges(pair.one, pair.other, least);
                found[k] = least;
            });
            best = *std::min_element(found.begin(), found.end());
        }
        return best;
    }

  private:
    Index end(Index b) const {
        return b + 1 < static_cast<Index>(starts_.size()) ? starts_[b + 1] : static_cast<Index>(facets_.size());
    }

    Parts<D> parts(Index b) const {
        Parts<D> own;
        for (Index f = starts_[b]; f < end(b); ++f)
            for (int k = 0; k < D; ++k) {
                own.nodes.push_back(facets_[f][k]);
                const auto [a, c] = std::minmax(facets_[f][k], facets_[f][(k + 1) % D]);
                if (D == 3) own.edges.push_back({a, c});
            }
        unique(own.nodes);
        unique(own.edges);
        for (const Node node : own.nodes) own.at_nodes.push_back(way_.range(node, most_));
        for (const auto& edge : own.edges) own.at_edges.push_back(way_.range(edge, most_));
        return own;
    }

    template <class T>
    static void unique(std::vector<T>& values) {
        std::sort(values.begin(), values.end());
        values.erase(std::unique(values.begin(), values.end()), values.end());
    }

    static bool share(const std::array<Node, 2>& one, const std::array<Node, 2>& other) {
        return (one[0] == other[0]) | (one[0] == other[1]) | (one[1] == other[0]) | (one[1] == other[1]);
    }

    bool may(const Range<D>& one, const Range<D>& other, double least) const {
        return meeting<D>(one, other) * most_ < least;
    }

    void nodes_at_facets(Index nodes, Index facets, double& least) const {
        for (std::size_t i = 0; i < parts_[nodes].nodes.size(); ++i) {
            const Range<D>& at = parts_[nodes].at_nodes[i];
            if (!may(at, blocks_[facets].places, least)) continue;
            for (Index f = starts_[facets]; f < end(facets); ++f)
                if (std::find(facets_[f].begin(), facets_[f].end(), parts_[nodes].nodes[i]) == facets_[f].end() &&
                    may(at, places_[f], least))
                    least = std::min(least, until<D>(way_, facets_[f], parts_[nodes].nodes[i], std::min(least, most_)));
        }
    }

    void edges_at_edges(Index first, Index second, double& least) const {
        const Parts<D>&one = parts_[first], &other = parts_[second];
        std::vector<std::size_t> near;
        for (std::size_t j = 0; j < other.edges.size(); ++j)
            if (may(other.at_edges[j], blocks_[first].places, least)) near.push_back(j);
        for (std::size_t i = 0; i < one.edges.size() && !near.empty(); ++i) {
            if (!may(one.at_edges[i], blocks_[second].places, least)) continue;
            for (const std::size_t j : near)
                if ((first != second || j > i) && !share(one.edges[i], other.edges[j]) && may(one.at_edges[i], other.at_edges[j], least))
                    least = std::min(least, until(way_, one.edges[i], other.edges[j], std::min(least, most_)));
        }
    }

    Way<D> way_;
    double most_;
    std::vector<std::array<Node, D>> facets_;
    std::vector<Range<D>> places_;
    std::vector<Index> starts_;  // of the blocks
    std::vector<Block<D>> blocks_;
    std::vector<Parts<D>> parts_;
};

}  // namespace

double first_contact(Matrix<const double> points, Matrix<const double> before, Matrix<const Node> facets,
                     Vector<const Index> starts, Vector<const bool> moving, double most) {
    require(before.shape() == points.shape(), "before: expected the shape of points");
    require(facets.shape(1) == points.shape(1) && moving.size() == facets.shape(0), "facets, moving: expected (f, d), (f,)");
    require(points.shape(1) == 2 || points.shape(1) == 3, "points: expected two or three coordinates");
    require_below(facets, points.shape(0), "facets: expected numbers of points");
    require_below(starts, facets.shape(0), "starts: expected numbers of facets");
    require(std::is_sorted(starts.begin(), starts.end()), "starts: expected ascending numbers");
    if (points.shape(1) == 2) return Boundary<2>({points, before}, facets, starts, moving, most).first_contact();
    return Boundary<3>({points, before}, facets, starts, moving, most).first_contact();
}

}  // namespace mesh_motion
