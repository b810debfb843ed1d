#include "mesh/approaching.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "parallel.h"

namespace mesh_motion {
namespace {

constexpr Index facets_in_block = 32, blocks_in_group = 16;
constexpr double rounding = 1e-12;
constexpr double facing = 0.3;  // largest cosine between the normals of facets that may meet: they may turn on the way

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

template <int D>
bool meet(const Range<D>& one, const Range<D>& other) {
    double enter = 0.0, leave = 1.0;
    for (int axis = 0; axis < D; ++axis) {
        limit(one.low[0][axis] - other.high[0][axis], one.low[1][axis] - other.high[1][axis], enter, leave);
        limit(other.low[0][axis] - one.high[0][axis], other.low[1][axis] - one.high[1][axis], enter, leave);
        if (enter > leave) return false;
    }
    return true;
}

template <int D>
struct Block {
    Range<D> places;
    Range<D> normals;  // of both ends the first
    bool moving = false;
    std::vector<Node> nodes;  // of a block, not of a group

    void add(const Block& other) {
        places.add(other.places);
        normals.add(other.normals);
        moving |= other.moving;
    }
};

/// The least scalar product of normals in two ranges, or less.
template <int D>
double least_cosine(const Range<D>& one, const Range<D>& other) {
    double sum = 0.0;
    for (int axis = 0; axis < D; ++axis) {
        const double a = one.low[0][axis], b = one.high[0][axis], c = other.low[0][axis], d = other.high[0][axis];
        sum += std::min({a * c, a * d, b * c, b * d});
    }
    return sum;
}

/// Whether facets of two blocks may meet.
template <int D>
bool may_meet(const Block<D>& one, const Block<D>& other) {
    return (one.moving || other.moving) && meet<D>(one.places, other.places) &&
           least_cosine<D>(one.normals, other.normals) <= facing;
}

template <int D>
Vec<D> place(Matrix<const double> points, Node node) {
    Vec<D> x;
    for (int axis = 0; axis < D; ++axis) x[axis] = points(node, axis);
    return x;
}

/// Unit vector to the inner side.
template <int D>
Vec<D> normal_of(Matrix<const double> points, Vector<const Node> facet) {
    const Vec<D> a = place<D>(points, facet[0]), b = place<D>(points, facet[1]);
    Vec<D> normal;
    if constexpr (D == 2) {
        normal = {a[1] - b[1], b[0] - a[0]};
    } else {
        const Vec<D> c = place<D>(points, facet[2]);
        for (int axis = 0; axis < 3; ++axis) {
            const int next = (axis + 1) % 3, last = (axis + 2) % 3;
            normal[axis] = (b[next] - a[next]) * (c[last] - a[last]) - (b[last] - a[last]) * (c[next] - a[next]);
        }
    }
    double square = 0.0;
    for (double part : normal) square += part * part;
    const double length = std::sqrt(square);
    for (double& part : normal) part = length > 0.0 ? part / length : 0.0;
    return normal;
}

template <int D>
Owned<Node, 2> found_in(Matrix<const double> points, Matrix<const double> there, Matrix<const Node> facets,
                        Vector<const bool> moving) {
    const Index n = facets.shape(0), count = (n + facets_in_block - 1) / facets_in_block;
    std::vector<Vec<D>> normals(n);
    std::vector<Range<D>> places(n);
    std::vector<Block<D>> blocks(count);
    const auto place_at = [&](Node node) {
        Range<D> range;
        for (int axis = 0; axis < D; ++axis) {
            range.add(0, axis, points(node, axis), points(node, axis));
            range.add(1, axis, there(node, axis), there(node, axis));
        }
        return range;
    };
    for_blocks(count, [&](Index b) {
        Block<D>& block = blocks[b];
        for (Index f = b * facets_in_block; f < std::min(n, (b + 1) * facets_in_block); ++f) {
            normals[f] = normal_of<D>(points, facets[f]);
            for (const Node node : facets[f]) places[f].add(place_at(node)), block.nodes.push_back(node);
            block.places.add(places[f]);
            for (int axis = 0; axis < D; ++axis) block.normals.add(0, axis, normals[f][axis], normals[f][axis]);
            block.moving |= moving[f];
        }
        std::sort(block.nodes.begin(), block.nodes.end());
        block.nodes.erase(std::unique(block.nodes.begin(), block.nodes.end()), block.nodes.end());
    });
    std::vector<Block<D>> groups((count + blocks_in_group - 1) / blocks_in_group);
    for (Index b = 0; b < count; ++b) groups[b / blocks_in_group].add(blocks[b]);
    const auto side = [&](Index node, Index f) {  // of the facet's plane: 1 the inner, −1 the outer one, 0 in the plane
        double height = 0.0, scale = 0.0;
        for (int axis = 0; axis < D; ++axis) {
            const double off = points(node, axis) - points(facets(f, 0), axis);
            height += normals[f][axis] * off;
            scale += std::abs(off);
        }
        return (height > rounding * scale) - (height < -rounding * scale);
    };
    std::vector<std::vector<Node>> found(count);
    for_blocks(count, [&](Index b) {
        std::vector<Node> own;
        const auto add = [&](const Block<D>& other) {
            for (const Node node : other.nodes) {
                const Range<D> at = place_at(node);
                if (!meet<D>(at, blocks[b].places)) continue;
                for (Index f = b * facets_in_block; f < std::min(n, (b + 1) * facets_in_block); ++f) {
                    if (!meet<D>(at, places[f])) continue;
                    const int on = side(node, f);
                    if (on == 0) continue;
                    own.insert(own.end(), facets[f].begin(), facets[f].end());
                    if (on < 0) std::swap(own[own.size() - 1], own[own.size() - 2]);
                    own.push_back(node);
                }
            }
        };
        for (std::size_t g = 0; g < groups.size(); ++g) {
            if (!may_meet<D>(groups[g], blocks[b])) continue;
            const Index first = static_cast<Index>(g) * blocks_in_group;
            for (Index other = first; other < std::min(count, first + blocks_in_group); ++other)
                if (may_meet<D>(blocks[other], blocks[b])) add(blocks[other]);
        }
        found[b] = std::move(own);
    });
    Owned<Node, 2> all{{}, {0, D + 1}};
    for (const std::vector<Node>& rows : found) all.values.insert(all.values.end(), rows.begin(), rows.end());
    all.shape[0] = static_cast<Index>(all.values.size()) / (D + 1);
    return all;
}

}  // namespace

Owned<Node, 2> approaching_nodes(Matrix<const double> points, Matrix<const double> there, Matrix<const Node> facets,
                                 Vector<const bool> moving) {
    require(there.shape() == points.shape(), "there: expected the shape of points");
    require(facets.shape(1) == points.shape(1) && moving.size() == facets.shape(0), "facets, moving: expected (f, d), (f,)");
    require(points.shape(1) == 2 || points.shape(1) == 3, "points: expected two or three coordinates");
    require_below(facets, points.shape(0), "facets: expected numbers of points");
    return points.shape(1) == 2 ? found_in<2>(points, there, facets, moving) : found_in<3>(points, there, facets, moving);
}

}  // namespace mesh_motion
