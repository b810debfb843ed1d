#include "two_scale/grid_sums.h"

#include "interpolation/basis.h"
#include "lanes.h"
#include "two_scale/chebyshev.h"
#include "parallel.h"

namespace mesh_motion {
namespace {

/// Chebyshev points along an axis of a block for its farthest and nearest far centres, and the largest number of grid
/// points.
constexpr int least_order = 4, last_order = 8, side = 13;

/// Extent of a block along an axis.
struct Part {
    Index first;
    int size;
    double middle, half;

    /// Part i when n points are divided into as few parts as possible, of about equal size.
    Part(Index i, Index n, double low, double spacing) {
        const Index parts = count(n);
        first = n * i / parts;
        size = static_cast<int>(n * (i + 1) / parts - first);
        middle = low + 0.5 * spacing * static_cast<double>(2 * first + size - 1);
        half = 0.5 * spacing * (size - 1);
    }
    static Index count(Index n) { return (n + side - 1) / side; }

    /// Lagrange functions of an order at a block's grid points.
    void resample(int order, Resampling& matrix) const {
        for (int x = 0; x < size; ++x) set(order, size > 1 ? 2.0 * x / (size - 1) - 1.0 : 0.0, x, matrix);
    }
    /// Lagrange functions of an order at the Chebyshev points of the next.
    static void raise(int order, Resampling& matrix) {
        for (int x = 0; x <= order; ++x) set(order, chebyshev_place(order + 1, x), x, matrix);
    }

  private:
    static void set(int order, double u, int x, Resampling& matrix) {
        std::array<double, most_order> functions;
        lagrange_functions(u, order, functions);
        for (int i = 0; i < order; ++i) matrix[i][x] = functions[i];
    }
};

using Block = std::array<Part, 3>;

constexpr int beyond_reach = -1;

/// The order of interpolation that each centre needs; 0 for near centres, and if the support of a centre ends in the
/// block.
std::vector<int> orders_of(Matrix<const double> centres, const Block& block, double reach,
                           Vector<const double> distances) {
    const double half = std::max({block[0].half, block[1].half, block[2].half});
    std::vector<int> orders(centres.shape(1));
    for (Index j = 0; j < centres.shape(1); ++j) {
        double square = 0.0, nearest = 0.0, furthest = 0.0;
        for (int axis = 0; axis < 3; ++axis) {
            const double off = std::abs(centres(axis, j) - block[axis].middle), beyond = std::max(off - half, 0.0);
            const double least = std::max(off - block[axis].half, 0.0), most = off + block[axis].half;
            square += beyond * beyond;
            nearest += least * least;
            furthest += most * most;
        }
        const double away = half + std::sqrt(square);  // more than the distance for a centre opposite a corner
        if (nearest >= reach * reach) orders[j] = beyond_reach;
        else if (furthest <= reach * reach)
            for (int order = last_order; order >= least_order; --order)
                if (away > distances[order] * half) orders[j] = order;
    }
    return orders;
}

/// Coordinates along three axes of the places of a block.
using Along = std::array<std::vector<double>, 3>;

/// Centres side by side, for sums at all places of a block; coordinates in support radii.
class Members {
  public:
    /// Takes the centres (3, nc) with weights (k, nc) whose order is the wanted one.
    Members(Matrix<const double> centres, Matrix<const double> weights, double inverse_radius,
            const std::vector<int>& orders, int wanted)
        : inverse_radius_(inverse_radius) {
        for (Index j = 0; j < centres.shape(1); ++j) {
            if (orders[j] != wanted) continue;
            numbers_.push_back(j);
            for (int axis = 0; axis < 3; ++axis) at_[axis].push_back(centres(axis, j) * inverse_radius);
            for (Index c = 0; c < weights.shape(0); ++c) weights_.push_back(weights(c, j));
        }
    }

    Index size() const { return static_cast<Index>(at_[0].size()); }

    /// values (places, k) = Σ_j w_j φ(|x − x_j|/R), K components at a time. A vector has eight places that differ in y
    /// and z; the squared distances along these axes are used for every x. Each sum is in the order of the centres.
    template <class Basis, Index K>
    void sum(const Along& along, Index k, double* values) const {
        const Index n = size(), ny = along[1].size(), nz = along[2].size();
        std::vector<double> across(n * lanes), ahead(along[0].size() * n);
        for (std::size_t i = 0; i < along[0].size(); ++i)
            for (Index j = 0; j < n; ++j) ahead[i * n + j] = square(along[0][i] * inverse_radius_ - at_[0][j]);
        for (Index first = 0; first < ny * nz; first += lanes) {
            double y[lanes], z[lanes];
            for (Index l = 0; l < lanes; ++l) {
                const Index place = std::min(first + l, ny * nz - 1);
                y[l] = along[1][place / nz] * inverse_radius_;
                z[l] = along[2][place % nz] * inverse_radius_;
            }
            for (Index j = 0; j < n; ++j)
                for (Index l = 0; l < lanes; ++l)
                    across[j * lanes + l] = square(y[l] - at_[1][j]) + square(z[l] - at_[2][j]);
            for (std::size_t i = 0; i < along[0].size(); ++i)
                for (Index c = 0; c < k; c += K)
                    sum_lanes<Basis, K>(&ahead[i * n], across.data(), c, k, values + (i * ny * nz + first) * k,
                                        std::min(lanes, ny * nz - first));
        }
    }

    /// back (k, nc) += Σ_places values (places, k) φ(|x − x_j|/R) of these centres: the transpose of sum. Here a vector
    /// has eight centres.
    template <class Basis, Index K>
    void add_transposed(const Along& along, Index k, const double* values, double* back, Index nc) const {
        const Index n = size(), nz = along[2].size(), plane = along[1].size() * nz;
        double squares[3][side][lanes];
        std::vector<double> across(plane * lanes);
        for (Index first = 0; first < n; first += lanes) {
            for (int axis = 0; axis < 3; ++axis)
                for (std::size_t i = 0; i < along[axis].size(); ++i)
                    for (Index l = 0; l < lanes; ++l)
                        squares[axis][i][l] =
                            square(along[axis][i] * inverse_radius_ - at_[axis][std::min(first + l, n - 1)]);
            for (Index place = 0; place < plane; ++place)
                for (Index l = 0; l < lanes; ++l)
                    across[place * lanes + l] = squares[1][place / nz][l] + squares[2][place % nz][l];
            for (Index c = 0; c < k; c += K) {
                double sums[K][lanes] = {};
                for (std::size_t i = 0; i < along[0].size(); ++i)
                    add_plane<Basis, K>(squares[0][i], across.data(), plane, values + i * plane * k + c, k, sums);
                for (Index l = 0; l < std::min(lanes, n - first); ++l)
                    for (Index m = 0; m < K; ++m) back[(c + m) * nc + numbers_[first + l]] += sums[m][l];
            }
        }
    }

  private:
    static double square(double x) { return x * x; }

    /// The components c … c + K − 1 at up to eight places.
    template <class Basis, Index K>
    void sum_lanes(const double* __restrict ahead, const double* __restrict across, Index c, Index k,
                   double* __restrict values, Index places) const {
        double sums[K][lanes] = {};
        const double* weight = weights_.data() + c;
        for (Index j = 0; j < size(); ++j, weight += k)
            for (Index l = 0; l < lanes; ++l) {
                const double value = Basis::phi(std::sqrt(ahead[j] + across[j * lanes + l]));
                for (Index m = 0; m < K; ++m) sums[m][l] += weight[m] * value;
            }
        for (Index l = 0; l < places; ++l)
            for (Index m = 0; m < K; ++m) values[l * k + c + m] = sums[m][l];
    }

    /// sums += K components of the values at the places of a plane, for eight centres.
    template <class Basis, Index K>
    static void add_plane(const double* __restrict ahead, const double* __restrict across, Index plane,
                          const double* __restrict values, Index k, double (&sums)[K][lanes]) {
        double total[K][lanes];
        std::copy_n(&sums[0][0], K * lanes, &total[0][0]);
        for (Index place = 0; place < plane; ++place, values += k)
            for (Index l = 0; l < lanes; ++l) {
                const double value = Basis::phi(std::sqrt(ahead[l] + across[place * lanes + l]));
                for (Index m = 0; m < K; ++m) total[m][l] += values[m] * value;
            }
        std::copy_n(&total[0][0], K * lanes, &sums[0][0]);
    }

    double inverse_radius_;
    std::array<std::vector<double>, 3> at_;
    std::vector<Index> numbers_;
    std::vector<double> weights_;
};

/// Places of an order's Chebyshev points in a block; for order 0 the block's own grid points.
Along places_of(const Block& block, int order, Vector<const double> low, double spacing) {
    Along along;
    for (int axis = 0; axis < 3; ++axis) {
        const Part& part = block[axis];
        for (int i = 0; i < (order ? order : part.size); ++i)
            along[axis].push_back(order ? part.middle + part.half * chebyshev_place(order, i)
                                        : low[axis] + spacing * static_cast<double>(part.first + i));
    }
    return along;
}

template <class Basis>
void sum_block(Matrix<const double> centres, Matrix<const double> weights, double inverse_radius, double reach,
               const Block& block, Vector<const double> low, double spacing, Vector<const double> distances, Cube<double> out) {
    const Index k = weights.shape(0);
    const std::vector<int> orders = orders_of(centres, block, reach, distances);
    std::vector<double> room(resampling_room<3>(side, k));
    // the sums over the centres of an order
    const auto sums = [&](int order, const Along& along) {
        std::vector<double> values(along[0].size() * along[1].size() * along[2].size() * k);
        const Members members(centres, weights, inverse_radius, orders, order);
        if (members.size() == 0) return values;
        if (k == 3) members.sum<Basis, 3>(along, k, values.data());
        else members.sum<Basis, 1>(along, k, values.data());
        return values;
    };
    std::vector<double> few;
    for (int order = least_order; order <= last_order; ++order) {
        std::vector<double> raised = sums(order, places_of(block, order, low, spacing));
        if (order > least_order) {
            Resampling matrix;
            Part::raise(order - 1, matrix);
            const Resampling* const matrices[]{&matrix, &matrix, &matrix};
            const int sizes[]{order, order, order};
            add_resampled<3>(few.data(), order - 1, matrices, sizes, k, raised.data(), room.data());
        }
        few = std::move(raised);
    }
    std::array<Resampling, 3> matrix;
    for (int axis = 0; axis < 3; ++axis) block[axis].resample(last_order, matrix[axis]);
    std::vector<double> total = sums(0, places_of(block, 0, low, spacing));
    const Resampling* const matrices[]{&matrix[0], &matrix[1], &matrix[2]};
    const int sizes[]{block[0].size, block[1].size, block[2].size};
    add_resampled<3>(few.data(), last_order, matrices, sizes, k, total.data(), room.data());
    const double* line = total.data();
    for (Index x = block[0].first; x < block[0].first + sizes[0]; ++x)
        for (Index y = block[1].first; y < block[1].first + sizes[1]; ++y, line += sizes[2] * k)
            std::copy(line, line + sizes[2] * k, out[x][y].data() + block[2].first * k);
}

static_assert(last_order <= lanes);

/// The last axis of restricted: each line of values (q, K) becomes one of p. A vector has the p places of a component.
template <Index K>
void restrict_lines(const std::vector<double>& values, int p, const Resampling& matrix, int q, Index k,
                    std::vector<double>& few) {
    double turned[side][lanes] = {};
    for (int x = 0; x < q; ++x)
        for (int i = 0; i < p; ++i) turned[x][i] = matrix[i][x];
    const double* from = values.data();
    for (double* to = few.data(); to != few.data() + few.size(); from += q * k, to += p * k)
        for (Index c = 0; c < k; c += K) {
            double sums[K][lanes] = {};
            for (int x = 0; x < q; ++x)
                for (Index m = 0; m < K; ++m)
                    for (Index i = 0; i < lanes; ++i) sums[m][i] += turned[x][i] * from[x * k + c + m];
            for (int i = 0; i < p; ++i)
                for (Index m = 0; m < K; ++m) to[i * k + c + m] = sums[m][i];
        }
}

/// few (p^3, k) = the transpose of add_resampled of values (q[0] × q[1] × q[2], k), along one axis after the other.
std::vector<double> restricted(std::vector<double> values, int p, const Resampling* const* matrices, const int* q,
                               Index k) {
    Index before = 1, after = Index{q[1]} * q[2] * k;
    for (int axis = 0; axis < 2; ++axis) {
        std::vector<double> few(before * p * after);
        for (Index b = 0; b < before; ++b)
            for (int i = 0; i < p; ++i)
                for (int x = 0; x < q[axis]; ++x) {
                    const double weight = (*matrices[axis])[i][x];
                    const double* __restrict from = values.data() + (b * q[axis] + x) * after;
                    double* __restrict to = few.data() + (b * p + i) * after;
                    for (Index m = 0; m < after; ++m) to[m] += weight * from[m];
                }
        values = std::move(few);
        before *= p;
        after /= q[axis + 1];
    }
    std::vector<double> few(before * p * k);
    if (k == 3) restrict_lines<3>(values, p, *matrices[2], q[2], k, few);
    else restrict_lines<1>(values, p, *matrices[2], q[2], k, few);
    return few;
}

/// The transpose of sum_block: back (k, nc) += …
template <class Basis>
void sum_block_back(Matrix<const double> centres, Index k, double inverse_radius, double reach, const Block& block,
                    Vector<const double> low, double spacing, Vector<const double> distances, Cube<const double> values,
                    double* back) {
    const Index nc = centres.shape(1);
    const std::vector<int> orders = orders_of(centres, block, reach, distances);
    const Matrix<const double> weightless(nullptr, {0, nc});
    const auto add = [&](int order, const std::vector<double>& at) {
        const Members members(centres, weightless, inverse_radius, orders, order);
        if (members.size() == 0) return;
        const Along along = places_of(block, order, low, spacing);
        if (k == 3) members.add_transposed<Basis, 3>(along, k, at.data(), back, nc);
        else members.add_transposed<Basis, 1>(along, k, at.data(), back, nc);
    };
    std::vector<double> total;
    std::array<Resampling, 3> matrix;
    for (int axis = 0; axis < 3; ++axis) block[axis].resample(last_order, matrix[axis]);
    for (Index x = block[0].first; x < block[0].first + block[0].size; ++x)
        for (Index y = block[1].first; y < block[1].first + block[1].size; ++y) {
            const double* line = values[x][y].data() + block[2].first * k;
            total.insert(total.end(), line, line + block[2].size * k);
        }
    add(0, total);
    const Resampling* const matrices[]{&matrix[0], &matrix[1], &matrix[2]};
    const int sizes[]{block[0].size, block[1].size, block[2].size};
    std::vector<double> few = restricted(std::move(total), last_order, matrices, sizes, k);
    for (int order = last_order; order >= least_order; --order) {
        add(order, few);
        if (order == least_order) break;
        Resampling raise;
        Part::raise(order - 1, raise);
        const Resampling* const raises[]{&raise, &raise, &raise};
        const int raised[]{order, order, order};
        few = restricted(std::move(few), order - 1, raises, raised, k);
    }
}

/// Calls f(block b, its number) for all blocks of a grid of n points.
template <class F>
void for_grid_blocks(const std::array<Index, 3>& n, Vector<const double> low, double spacing, F&& f) {
    const std::array<Index, 3> parts{Part::count(n[0]), Part::count(n[1]), Part::count(n[2])};
    for_blocks(parts[0] * parts[1] * parts[2], [&](Index b) {
        const Block block{Part(b / (parts[1] * parts[2]), n[0], low[0], spacing),
                          Part(b / parts[2] % parts[1], n[1], low[1], spacing),
                          Part(b % parts[2], n[2], low[2], spacing)};
        f(block, b);
    });
}

}  // namespace

void sum_on_grid(int code, Matrix<const double> centres, Matrix<const double> weights, double inverse_radius,
                 double reach, Vector<const double> low, double spacing, Vector<const double> distances,
                 Cube<double> out) {
    const Index k = weights.shape(0);
    require(centres.shape(0) == 3 && weights.shape(1) == centres.shape(1) && k > 0,
            "centres, weights: expected (3, nc), (k, nc)");
    require(low.size() == 3 && distances.size() == last_order + 1, "low, distances: expected (3,), (9,)");
    require(out.shape(2) % k == 0, "out: expected (nx, ny, nz k)");
    const std::array<Index, 3> n{out.shape(0), out.shape(1), out.shape(2) / k};
    with_basis(code, [&](auto basis) {
        for_grid_blocks(n, low, spacing, [&](const Block& block, Index) {
            sum_block<decltype(basis)>(centres, weights, inverse_radius, reach, block, low, spacing, distances, out);
        });
    });
}

void sum_from_grid(int code, Matrix<const double> centres, Cube<const double> values, double inverse_radius,
                   double reach, Vector<const double> low, double spacing, Vector<const double> distances,
                   Matrix<double> out) {
    const Index k = out.shape(0), nc = centres.shape(1);
    require(centres.shape(0) == 3 && out.shape(1) == nc && k > 0, "centres, out: expected (3, nc), (k, nc)");
    require(low.size() == 3 && distances.size() == last_order + 1, "low, distances: expected (3,), (9,)");
    require(values.shape(2) % k == 0, "values: expected (nx, ny, nz k)");
    const std::array<Index, 3> n{values.shape(0), values.shape(1), values.shape(2) / k};
    const Index blocks = Part::count(n[0]) * Part::count(n[1]) * Part::count(n[2]), size = k * nc;
    std::vector<double> parts(blocks * size);  // added in order: the same result for any number of threads
    with_basis(code, [&](auto basis) {
        for_grid_blocks(n, low, spacing, [&](const Block& block, Index b) {
            sum_block_back<decltype(basis)>(centres, k, inverse_radius, reach, block, low, spacing, distances, values,
                                            parts.data() + b * size);
        });
    });
    std::fill(out.data(), out.data() + size, 0.0);
    for (Index b = 0; b < blocks; ++b)
        for (Index m = 0; m < size; ++m) out.data()[m] += parts[b * size + m];
}

}  // namespace mesh_motion
