#include "two_scale/spline.h"

#include <cmath>
#include <cstring>

#include "parallel.h"
#include "quad.h"

namespace mesh_motion {
namespace {

constexpr Index block = 2048;       // points in one task
constexpr Index numbers = 1 << 16;  // rows in one task of quasi-interpolation
constexpr double sixth = 1.0 / 6.0;

/// Values for the four splines of an axis that are not zero in a cell.
using Four = std::array<double, 4>;

/// The four splines at t in [0, 1].
Four splines(double t) {
    const double u = 1.0 - t, t2 = t * t, u2 = u * u;
    return {sixth * u2 * u, 4.0 * sixth - t2 + 0.5 * t2 * t, 4.0 * sixth - u2 + 0.5 * u2 * u, sixth * t2 * t};
}

/// Their derivatives.
Four slopes(double t) {
    const double u = 1.0 - t;
    return {-0.5 * u * u, (-2.0 + 1.5 * t) * t, (2.0 - 1.5 * u) * u, 0.5 * t * t};
}

/// One box with A axes, of which the last has cells.
template <int A>
struct Box {
    std::array<double, A> origin, end, cells;
    std::array<Index, A> stride;  // rows of coefficients between adjacent layers; 0 along an axis without cells
    double inverse;
    Index start;
};

template <int A>
std::vector<Box<A>> boxes_of(Matrix<const double> origin, Vector<const double> inverse, Matrix<const Index> cells,
                             Vector<const Index> start, Index rows) {
    std::vector<Box<A>> boxes(inverse.size());
    for (Index b = 0; b < inverse.size(); ++b) {
        Index layers = 1;
        for (int axis = A; axis-- > 0;) {
            const Index n = cells(b, axis);
            require(0 <= n && n < rows, "cells: expected as many as there are coefficients");
            boxes[b].origin[axis] = origin(b, axis);
            boxes[b].cells[axis] = static_cast<double>(n);
            boxes[b].stride[axis] = n > 0 ? layers : 0;
            layers *= n > 0 ? n + 3 : 1;
            require(layers <= rows, "coefficients: expected all of each box");
        }
        require(cells(b, A - 1) > 0, "cells: expected the same axes without cells in all boxes");
        require(0 <= start[b] && start[b] <= rows - layers, "coefficients: expected all of each box");
        for (int axis = 0; axis < A; ++axis)
            boxes[b].end[axis] = boxes[b].origin[axis] + boxes[b].cells[axis] / inverse[b];
        boxes[b].inverse = inverse[b];
        boxes[b].start = start[b];
    }
    return boxes;
}

template <int A>
const Box<A>& box_of(const std::array<double, A>& x, const std::vector<Box<A>>& boxes) {
    const Box<A>* box = boxes.data();
    for (; box != &boxes.back(); ++box) {
        bool inside = true;
        for (int axis = 0; axis < A && inside; ++axis)
            inside = box->origin[axis] <= x[axis] && x[axis] <= box->end[axis];
        if (inside) break;
    }
    return *box;
}

/// The cell of a place along an axis, and the position in it, in spacings from the lower corner. Places beyond the rims
/// are moved to the rims; NaN stays NaN, in cell 0.
struct Placed {
    double cell, within;

    Placed(double x, double origin, double inverse, double cells) {
        const double place = std::min(std::max((x - origin) * inverse, 0.0), cells);
        cell = place > 0.0 ? std::min(std::floor(place), cells - 1.0) : 0.0;
        within = place - cell;
    }
};

/// The stencil of a point in a box: its first coefficient, the distances between layers, and the weights; on request
/// also those of the slope along each axis.
template <int A, bool sloped>
struct Stencil {
    const double* first;
    const std::array<Index, A>& stride;
    std::array<Four, A> value, slope;

    Stencil(const std::array<double, A>& x, const Box<A>& box, Matrix<const double> coefficients) : stride(box.stride) {
        Index row = box.start;
        for (int axis = 0; axis < A; ++axis) {
            if (box.stride[axis] == 0) {
                value[axis] = {1.0, 0.0, 0.0, 0.0};
                slope[axis] = {};
                continue;
            }
            const Placed at(x[axis], box.origin[axis], box.inverse, box.cells[axis]);
            row += static_cast<Index>(at.cell) * box.stride[axis];
            value[axis] = splines(at.within);
            if constexpr (sloped)
                for (int m = 0; m < 4; ++m) slope[axis][m] = slopes(at.within)[m] * box.inverse;
        }
        first = coefficients.data() + row * coefficients.shape(1);
    }
};

using Eight [[gnu::vector_size(8 * sizeof(double))]] = double;

/// sums[f] = Σ of the W numbers at each point of a stencil, for F sets of weights. Numbers of a line along the last
/// axis are adjacent: they fill the vectors, for each W. Points of a line are `step` numbers apart.
template <int A, int W, int F, class Step>
[[gnu::always_inline]] inline void sum_stencil(const double* __restrict first, Step step,
                                               const std::array<Index, A>& stride,
                                               const std::array<const Four*, A> (&weights)[F], double (&sums)[F][W]) {
    constexpr int leading = A == 3 ? 16 : A == 2 ? 4 : 1;
    // a line's 4 W numbers are in the widest registers; separate sums of even and odd lines: a single one would wait
    // for each product
    constexpr int wide = W / 2, narrow = W % 2;
    std::array<Eight, wide> eights[F][2] = {};
    std::array<Quad, narrow> quads[F][2] = {};
#pragma GCC unroll 16
    for (int p = 0; p < leading; ++p) {
        const int layer[] = {A == 3 ? p / 4 : p, p % 4};
        const double* line = first;
        for (int axis = 0; axis < A - 1; ++axis) line += layer[axis] * stride[axis] * step;
        std::array<Eight, wide> eight;
        std::array<Quad, narrow> quad;
        if constexpr (std::is_same_v<Step, Index>) {
            quad[0] = Quad{line[0], line[step], line[2 * step], line[3 * step]};
        } else {
            for (int q = 0; q < wide; ++q) std::memcpy(&eight[q], line + 8 * q, sizeof(Eight));
            for (int q = 0; q < narrow; ++q) std::memcpy(&quad[q], line + 8 * wide, sizeof(Quad));
        }
        for (int f = 0; f < F; ++f) {
            double weight = 1.0;
            for (int axis = 0; axis < A - 1; ++axis) weight *= (*weights[f][axis])[layer[axis]];
            for (int q = 0; q < wide; ++q) eights[f][p % 2][q] += weight * eight[q];
            for (int q = 0; q < narrow; ++q) quads[f][p % 2][q] += weight * quad[q];
        }
    }
    for (int f = 0; f < F; ++f) {
        const Four& last = *weights[f][A - 1];
        for (int q = 0; q < wide; ++q) eights[f][0][q] += eights[f][1][q];
        for (int q = 0; q < narrow; ++q) quads[f][0][q] += quads[f][1][q];
        double line[4 * W];
        if constexpr (wide > 0) std::memcpy(line, eights[f][0].data(), sizeof eights[f][0]);
        if constexpr (narrow > 0) std::memcpy(line + 8 * wide, quads[f][0].data(), sizeof(Quad));
        for (int c = 0; c < W; ++c)
            sums[f][c] = (last[0] * line[c] + last[1] * line[W + c]) +
                         (last[2] * line[2 * W + c] + last[3] * line[3 * W + c]);
    }
}

/// The transpose of sum_stencil: W numbers, times the weights, are added to each point of a stencil.
template <int A, int W, class Step>
[[gnu::always_inline]] inline void add_stencil(double* first, Step step, const std::array<Index, A>& stride,
                                               const std::array<Four, A>& weights, const double* values) {
    constexpr int leading = A == 3 ? 16 : A == 2 ? 4 : 1, wide = W / 2, narrow = W % 2;
    double numbers[4 * W];
    for (int m = 0; m < 4; ++m)
        for (int c = 0; c < W; ++c) numbers[m * W + c] = weights[A - 1][m] * values[c];
    std::array<Eight, wide> eights;
    std::array<Quad, narrow> quads;
    if constexpr (wide > 0) std::memcpy(eights.data(), numbers, sizeof eights);
    if constexpr (narrow > 0) std::memcpy(quads.data(), numbers + 8 * wide, sizeof quads);
#pragma GCC unroll 16
    for (int p = 0; p < leading; ++p) {
        const int layer[] = {A == 3 ? p / 4 : p, p % 4};
        double* line = first;
        double weight = 1.0;
        for (int axis = 0; axis < A - 1; ++axis) {
            line += layer[axis] * stride[axis] * step;
            weight *= weights[axis][layer[axis]];
        }
        if constexpr (std::is_same_v<Step, Index>) {
            for (int m = 0; m < 4; ++m) line[m * step] += weight * quads[0][m];
        } else {
            for (int q = 0; q < wide; ++q) {
                Eight sum;
                std::memcpy(&sum, line + 8 * q, sizeof sum);
                sum += weight * eights[q];
                std::memcpy(line + 8 * q, &sum, sizeof sum);
            }
            for (int q = 0; q < narrow; ++q) {
                Quad sum;
                std::memcpy(&sum, line + 8 * wide, sizeof sum);
                sum += weight * quads[q];
                std::memcpy(line + 8 * wide, &sum, sizeof sum);
            }
        }
    }
}

/// Points in the order of the slabs of cells that contain them, each with its box. Slabs of a box that are not adjacent
/// share no coefficient.
class Slabs {
  public:
    template <int A>
    Slabs(Matrix<const double> points, const std::vector<Box<A>>& boxes) : first_(1, 0) {
        for (const Box<A>& box : boxes) first_.push_back(first_.back() + 1 + static_cast<Index>(box.cells[0]) / thick);
        const Index n = points.shape(0);
        std::vector<Node> slab(n);
        for_ranges(n, block, [&](Index begin, Index end) {
            for (Index i = begin; i < end; ++i) {
                std::array<double, A> x;
                for (int axis = 0; axis < A; ++axis) x[axis] = points(i, axis);
                const Box<A>& box = box_of<A>(x, boxes);
                const double cell = Placed(x[0], box.origin[0], box.inverse, box.cells[0]).cell;
                slab[i] = static_cast<Node>(first_[&box - boxes.data()] + static_cast<Index>(cell) / thick);
            }
        });
        starts_.assign(first_.back() + 1, 0);
        for (const Node s : slab) ++starts_[s + 1];
        for (std::size_t s = 1; s < starts_.size(); ++s) starts_[s] += starts_[s - 1];
        std::vector<Index> next(starts_.begin(), starts_.end() - 1);
        order_.resize(n);
        for (Index i = 0; i < n; ++i) order_[next[slab[i]]++] = static_cast<Node>(i);
    }

    /// Calls f(box, points) for the points of every slab, in their order; for slabs that share coefficients one after the
    /// other.
    template <class F>
    void for_slabs(F&& f) const {
        for (const Index parity : {0, 1}) {
            std::vector<std::pair<Index, Index>> tasks;  // box, slab
            for (std::size_t b = 0; b + 1 < first_.size(); ++b)
                for (Index s = first_[b] + parity; s < first_[b + 1]; s += 2) tasks.emplace_back(b, s);
            for_blocks(static_cast<Index>(tasks.size()), [&](Index t) {
                const auto [b, s] = tasks[t];
                f(b, Vector<const Node>(order_.data() + starts_[s], {starts_[s + 1] - starts_[s]}));
            });
        }
    }

  private:
    static constexpr Index thick = 4;  // cells; a stencil has four layers, so three would be enough
    std::vector<Index> first_, starts_;  // the first slab of each box, the first point of each slab
    std::vector<Node> order_;
};

/// Calls f(A, W) with both as constants: the axes up to the last with cells, and the number of components if it is 2 or
/// 3; otherwise W = 1, for one component after the other.
template <class F>
void with_shape(Matrix<const Index> cells, Index k, F&& f) {
    require(cells.shape(0) > 0 && cells.shape(1) == 3, "cells: expected (b, 3) of at least one box");
    Index axes = 3;
    while (axes > 1 && cells(0, axes - 1) == 0) --axes;
    with_dimension(axes, [&](auto a) {
        if (k == 3) f(a, std::integral_constant<int, 3>{});
        else if (k == 2) f(a, std::integral_constant<int, 2>{});
        else f(a, std::integral_constant<int, 1>{});
    });
}

/// Calls sums(i, c, stencil, step) for every point i and its components from c on, W at a time.
template <int A, int W, bool sloped, class Sums>
void for_stencils(Matrix<const double> points, const std::vector<Box<A>>& boxes, Matrix<const double> coefficients,
                  Sums&& sums) {
    const Index k = coefficients.shape(1);
    for_ranges(points.shape(0), block, [&](Index begin, Index end) {
        for (Index i = begin; i < end; ++i) {
            std::array<double, A> x;
            for (int axis = 0; axis < A; ++axis) x[axis] = points(i, axis);
            const Box<A>& box = box_of<A>(x, boxes);
            const Stencil<A, sloped> stencil(x, box, coefficients);
            if constexpr (W > 1) sums(i, Index{0}, stencil, std::integral_constant<Index, W>{});
            else
                for (Index c = 0; c < k; ++c) sums(i, c, stencil, k);
        }
    });
}

/// The parent's layers that form a layer: a spline of twice the spacing is also one of this spacing.
struct Subdivided {
    Index first;
    int count;
    double weight[3] = {1.0};

    /// Layer i of n, from the parent's layer `first` on.
    Subdivided(Index i, Index n, Index first) : first(first + i / 2), count(n == 1 ? 1 : i % 2 ? 3 : 2) {
        if (count == 3) weight[0] = weight[2] = 0.125, weight[1] = 0.75;
        if (count == 2) weight[0] = weight[1] = 0.5;
    }

    /// out (length): the sum of the layers in `from`, which are `stride` numbers apart.
    void sum(const double* __restrict from, Index stride, Index length, double* __restrict out) const {
        if (count == 3)
            for (Index m = 0; m < length; ++m)
                out[m] = (weight[0] * from[m] + weight[1] * from[m + stride]) + weight[2] * from[m + 2 * stride];
        else if (count == 2)
            for (Index m = 0; m < length; ++m) out[m] = weight[0] * from[m] + weight[1] * from[m + stride];
        else
            std::copy_n(from, length, out);
    }
};

void check(Matrix<const double> points, Matrix<const double> origin, Vector<const double> inverse,
           Matrix<const Index> cells, Vector<const Index> start) {
    require(points.shape(1) <= 3, "points: expected at most three coordinates");
    require(origin.shape(0) == inverse.size() && origin.shape(1) == 3 && cells.shape() == origin.shape() &&
                start.size() == inverse.size(),
            "origin, inverse, cells, start: expected (b, 3), (b,), (b, 3), (b,)");
}

}  // namespace

void spline_values(Matrix<const double> points, Matrix<const double> origin, Vector<const double> inverse,
                   Matrix<const Index> cells, Vector<const Index> start, Matrix<const double> coefficients,
                   Matrix<double> out) {
    check(points, origin, inverse, cells, start);
    const Index k = coefficients.shape(1);
    require(out.shape(0) == points.shape(0) && out.shape(1) == k, "out: expected (n, k)");
    with_shape(cells, k, [&](auto a, auto w) {
        constexpr int A = a, W = w;
        require(A <= points.shape(1), "points: expected a coordinate for each axis with cells");
        const auto boxes = boxes_of<A>(origin, inverse, cells, start, coefficients.shape(0));
        for_stencils<A, W, false>(points, boxes, coefficients, [&](Index i, Index c, const auto& at, auto step) {
            std::array<const Four*, A> weights[1];
            for (int axis = 0; axis < A; ++axis) weights[0][axis] = &at.value[axis];
            double sums[1][W];
            sum_stencil<A, W, 1>(at.first + c, step, at.stride, weights, sums);
            for (int m = 0; m < W; ++m) out(i, c + m) = sums[0][m];
        });
    });
}

void spline_gradients(Matrix<const double> points, Matrix<const double> origin, Vector<const double> inverse,
                      Matrix<const Index> cells, Vector<const Index> start, Matrix<const double> coefficients,
                      Cube<double> out) {
    check(points, origin, inverse, cells, start);
    const Index k = coefficients.shape(1), d = out.shape(2);
    require(out.shape(0) == points.shape(0) && out.shape(1) == k && d <= 3, "out: expected (n, k, d)");
    with_shape(cells, k, [&](auto a, auto w) {
        constexpr int A = a, W = w;
        require(A <= points.shape(1) && A <= d, "points, out: expected a coordinate for each axis with cells");
        const auto boxes = boxes_of<A>(origin, inverse, cells, start, coefficients.shape(0));
        for_stencils<A, W, true>(points, boxes, coefficients, [&](Index i, Index c, const auto& at, auto step) {
            std::array<const Four*, A> weights[A];
            for (int m = 0; m < A; ++m)
                for (int axis = 0; axis < A; ++axis) weights[m][axis] = axis == m ? &at.slope[axis] : &at.value[axis];
            double sums[A][W];
            sum_stencil<A, W, A>(at.first + c, step, at.stride, weights, sums);
            for (int v = 0; v < W; ++v)
                for (Index m = 0; m < d; ++m) out(i, c + v, m) = m < A ? sums[m][v] : 0.0;
        });
    });
}

void add_spline_coefficients(Matrix<const double> points, Matrix<const double> origin, Vector<const double> inverse,
                             Matrix<const Index> cells, Vector<const Index> start, Matrix<const double> values,
                             Matrix<double> out) {
    check(points, origin, inverse, cells, start);
    const Index k = out.shape(1);
    require(values.shape(0) == points.shape(0) && values.shape(1) == k, "values: expected (n, k)");
    with_shape(cells, k, [&](auto a, auto w) {
        constexpr int A = a, W = w;
        require(A <= points.shape(1), "points: expected a coordinate for each axis with cells");
        const auto boxes = boxes_of<A>(origin, inverse, cells, start, out.shape(0));
        const Matrix<const double> coefficients(out.data(), {out.shape(0), k});
        Slabs(points, boxes).for_slabs([&](Index b, Vector<const Node> slab) {
            for (const Node i : slab) {
                const double* const value = values[i].data();
                if (std::all_of(value, value + k, [](double part) { return part == 0.0; })) continue;
                std::array<double, A> x;
                for (int axis = 0; axis < A; ++axis) x[axis] = points(i, axis);
                const Stencil<A, false> at(x, boxes[b], coefficients);
                double* const first = out.data() + (at.first - coefficients.data());
                if constexpr (W > 1)
                    add_stencil<A, W>(first, std::integral_constant<Index, W>{}, at.stride, at.value, value);
                else
                    for (Index c = 0; c < k; ++c) add_stencil<A, W>(first + c, k, at.stride, at.value, value + c);
            }
        });
    });
}

void quasi_interpolate(Matrix<const double> values, Index stride, Matrix<double> out) {
    const Index rows = out.shape(0), length = out.shape(1);
    require(stride > 0 && values.shape(0) == rows && values.shape(1) == length + 2 * stride,
            "values: expected rows of two strides more than those of out");
    for_ranges(rows * length, numbers, [&](Index first, Index last) {
        for (Index at = first; at < last;) {
            const Index row = at / length, begin = at - row * length, end = std::min(last - row * length, length);
            const double* __restrict f = values.data() + row * (length + 2 * stride);
            double* __restrict c = out.data() + row * length;
            for (Index i = begin; i < end; ++i)
                c[i] = 8.0 * sixth * f[i + stride] - sixth * (f[i] + f[i + 2 * stride]);
            at = row * length + end;
        }
    });
}

void blend_with_parent(Cube<const double> parent, Vector<const Index> first, Vector<const double> share0,
                       Vector<const double> share1, Vector<const double> share2, Cube<double> own) {
    const std::array<Vector<const double>, 3> shares{share0, share1, share2};
    const Index layers = share2.size(), k = layers ? own.shape(2) / layers : 0;
    require(k > 0 && own.shape() == std::array{share0.size(), share1.size(), layers * k} && parent.shape(2) % k == 0,
            "parent, own: expected (p0, p1, p2 k), (n0, n1, n2 k)");
    require(first.size() == 3, "first: expected three layers");
    const std::array<Index, 3> available{parent.shape(0), parent.shape(1), parent.shape(2) / k};
    for (int axis = 0; axis < 3; ++axis) {
        const Index n = shares[axis].size(), needed = n == 1 ? 1 : n / 2 + 2;
        require(n % 2 == 1 && 0 <= first[axis] && first[axis] <= available[axis] - needed,
                "parent, first: expected the parent's layers around the box");
    }
    const Index across = parent.shape(2), plane = parent.shape(1) * across;
    for_blocks(share0.size(), [&](Index x) {
        std::vector<double> layer(plane), row(across), inherited(k);
        const Subdivided along0(x, share0.size(), first[0]);
        along0.sum(parent.data() + along0.first * plane, plane, plane, layer.data());
        for (Index y = 0; y < share1.size(); ++y) {
            const Subdivided along1(y, share1.size(), first[1]);
            along1.sum(layer.data() + along1.first * across, across, across, row.data());
            const double share01 = share0[x] * share1[y];
            double* coefficient = own[x][y].data();
            for (Index z = 0; z < layers; ++z, coefficient += k) {
                const Subdivided along2(z, layers, first[2]);
                along2.sum(row.data() + along2.first * k, k, k, inherited.data());
                const double share = share01 * share2[z];
                for (Index c = 0; c < k; ++c) coefficient[c] = inherited[c] + share * (coefficient[c] - inherited[c]);
            }
        }
    });
}

}  // namespace mesh_motion
