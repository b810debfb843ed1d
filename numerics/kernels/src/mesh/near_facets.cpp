#include "mesh/near_facets.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "parallel.h"

namespace mesh_motion {
namespace {

constexpr Index leaf = 4;        // facets in a smallest box
constexpr Index together = 256;  // pairs of smallest boxes in one task

template <int d>
struct Box {
    std::array<double, d> low, high;
    bool moves = false;

    Box() {
        low.fill(std::numeric_limits<double>::infinity());
        high.fill(-std::numeric_limits<double>::infinity());
    }
    void add(const Box& other) {
        for (int i = 0; i < d; ++i) low[i] = std::min(low[i], other.low[i]), high[i] = std::max(high[i], other.high[i]);
        moves |= other.moves;
    }
    /// Whether both are within a margin of each other, and one of them moves.
    bool meets(const Box& other, double margin) const {
        bool apart = !(moves | other.moves);
        for (int i = 0; i < d; ++i) apart |= (low[i] - other.high[i] > margin) | (other.low[i] - high[i] > margin);
        return !apart;
    }
};

/// Facets with their boxes and the boxes of groups of them: each level has half as many as the one below.
template <int d>
class Tree {
  public:
    static constexpr int width = d == 2 ? 2 : 4;
    using Pair = std::array<Index, 2>;

    Tree(Matrix<const double> points, Matrix<const Node> facets, Vector<const bool> moving, double margin)
        : points_(points), facets_(facets), margin_(margin), own_(facets.shape(0)), normals_(facets.shape(0)) {
        for (Index f = 0; f < facets.shape(0); ++f) {
            own_[f].moves = moving[f];
            for (int k = 0; k < nodes_of(f); ++k)
                for (int i = 0; i < d; ++i) {
                    own_[f].low[i] = std::min(own_[f].low[i], at(f, k)[i]);
                    own_[f].high[i] = std::max(own_[f].high[i], at(f, k)[i]);
                }
            normals_[f] = normal_of(f);
        }
        levels_.push_back(halved(own_, leaf));
        while (levels_.back().size() > 1) levels_.push_back(halved(levels_.back(), 2));
    }

    /// All pairs, in an order that does not depend on the number of threads.
    std::vector<Index> pairs() const {
        std::vector<Pair> near;
        if (!own_.empty()) near.push_back({0, 0});
        for (Index level = static_cast<Index>(levels_.size()) - 1; level > 0; --level) near = below(near, level);
        const Index n = static_cast<Index>(near.size());
        std::vector<std::vector<Index>> parts((n + together - 1) / together);
        for_ranges(n, together, [&](Index begin, Index end) {
            for (Index k = begin; k < end; ++k) add_leaf(near[k], parts[begin / together]);
        });
        std::vector<Index> found;
        for (const auto& part : parts) found.insert(found.end(), part.begin(), part.end());
        return found;
    }

  private:
    static std::vector<Box<d>> halved(const std::vector<Box<d>>& boxes, Index count) {
        std::vector<Box<d>> found((boxes.size() + count - 1) / count);
        for (std::size_t k = 0; k < boxes.size(); ++k) found[k / count].add(boxes[k]);
        return found;
    }

    int nodes_of(Index f) const { return width == 4 && facets_(f, 3) < 0 ? 3 : width; }
    const double* at(Index f, int k) const { return points_.data() + d * Index{facets_(f, k)}; }

    /// A vector normal to the facet, on average.
    std::array<double, d> normal_of(Index f) const {
        if constexpr (d == 2) return {at(f, 1)[1] - at(f, 0)[1], at(f, 0)[0] - at(f, 1)[0]};
        else {
            const bool quad = nodes_of(f) == 4;
            const double *a = at(f, 0), *b = at(f, 1), *c = at(f, 2), *e = quad ? at(f, 3) : a;
            const double *from = quad ? b : a, *to = quad ? e : b;  // diagonals of a quad, sides of a triangle
            std::array<double, d> found;
            for (int i = 0; i < 3; ++i) {
                const int j = (i + 1) % 3, k = (i + 2) % 3;
                found[i] = (c[j] - a[j]) * (to[k] - from[k]) - (c[k] - a[k]) * (to[j] - from[j]);
            }
            return found;
        }
    }

    /// The pairs of boxes in the next level that may meet, of those on this level.
    std::vector<Pair> below(const std::vector<Pair>& near, Index level) const {
        const auto& boxes = levels_[level - 1];
        std::vector<Pair> found;
        for (const auto [one, other] : near)
            for (Index a = 2 * one; a < std::min<Index>(2 * one + 2, boxes.size()); ++a)
                for (Index b = one == other ? a : 2 * other; b < std::min<Index>(2 * other + 2, boxes.size()); ++b)
                    if (boxes[a].meets(boxes[b], margin_)) found.push_back({a, b});
        return found;
    }

    void add_leaf(Pair boxes, std::vector<Index>& found) const {
        const auto [one, other] = boxes;
        const Index count = static_cast<Index>(own_.size());
        for (Index a = leaf * one; a < std::min(count, leaf * (one + 1)); ++a)
            for (Index b = one == other ? a + 1 : leaf * other; b < std::min(count, leaf * (other + 1)); ++b)
                if (own_[a].meets(own_[b], margin_) && !share_a_node(a, b) && !separated(a, b, normals_[a]) &&
                    !separated(a, b, normals_[b]))
                    found.insert(found.end(), {std::min(a, b), std::max(a, b)});
    }

    bool share_a_node(Index a, Index b) const {
        bool share = false;
        for (int k = 0; k < nodes_of(a); ++k)
            for (int l = 0; l < nodes_of(b); ++l) share |= facets_(a, k) == facets_(b, l);
        return share;
    }

    /// Whether there is a gap along a direction.
    bool separated(Index a, Index b, const std::array<double, d>& along) const {
        double square = 0.0;
        for (double entry : along) square += entry * entry;
        const auto range = [&](Index f) {
            double low = std::numeric_limits<double>::infinity(), high = -low;
            for (int k = 0; k < nodes_of(f); ++k) {
                double place = 0.0;
                for (int i = 0; i < d; ++i) place += along[i] * (at(f, k)[i] - at(a, 0)[i]);
                low = std::min(low, place), high = std::max(high, place);
            }
            return std::array{low, high};
        };
        const auto one = range(a), other = range(b);
        return std::max(one[0] - other[1], other[0] - one[1]) > margin_ * std::sqrt(square);
    }

    Matrix<const double> points_;
    Matrix<const Node> facets_;
    double margin_;
    std::vector<Box<d>> own_;
    std::vector<std::array<double, d>> normals_;
    std::vector<std::vector<Box<d>>> levels_;  // the smallest boxes first
};

}  // namespace

Owned<Index, 2> near_facets(Matrix<const double> points, Matrix<const Node> facets, Vector<const bool> moving,
                            double margin) {
    const Index d = points.shape(1), width = facets.shape(1), f = facets.shape(0);
    require((d == 2 && width == 2) || (d == 3 && width == 4), "facets: expected two columns in 2D, four in 3D");
    require(moving.size() == f, "moving: expected one entry for each facet");
    std::vector<Node> used;
    for (Index k = 0; k < f; ++k)
        for (Index i = 0; i < width - (width == 4 && facets(k, 3) < 0); ++i) used.push_back(facets(k, i));
    require_below(Vector<const Node>(view_of(used)), points.shape(0), "facets: expected numbers of points");
    std::vector<Index> found =
        d == 2 ? Tree<2>(points, facets, moving, margin).pairs() : Tree<3>(points, facets, moving, margin).pairs();
    const Index pairs = static_cast<Index>(found.size()) / 2;
    return {std::move(found), {pairs, 2}};
}

}  // namespace mesh_motion
