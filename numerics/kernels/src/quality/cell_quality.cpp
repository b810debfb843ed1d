#include "quality/cell_quality.h"

#include <limits>
#include <numeric>

#include "interpolation/basis.h"
#include "parallel.h"
#include "quality/angle_law.h"
#include "quality/jacobians.h"

namespace mesh_motion {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr double smallest = 1e-290;  // smaller determinants are taken as 0: their roots would have too few digits

/// One corner of one cell of the chunk.
template <int d>
struct Corner {
    double a[d][d];

    [[gnu::always_inline]] Corner(const Jacobians<d>& all, Index s) {
        for (int i = 0; i < d; ++i)
            for (int j = 0; j < d; ++j) a[i][j] = all.entry[i][j][s];
    }

    [[gnu::always_inline]] double determinant() const {
        if constexpr (d == 1) {
            return a[0][0];
        } else if constexpr (d == 2) {
            return a[0][0] * a[1][1] - a[0][1] * a[1][0];
        } else {
            return a[0][0] * (a[1][1] * a[2][2] - a[2][1] * a[1][2]) +
                   a[1][0] * (a[2][1] * a[0][2] - a[0][1] * a[2][2]) +
                   a[2][0] * (a[0][1] * a[1][2] - a[1][1] * a[0][2]);
        }
    }

    /// Entry i, j of λ = AᵀA.
    [[gnu::always_inline]] double lambda(int i, int j) const {
        double sum = a[0][i] * a[0][j];
        for (int k = 1; k < d; ++k) sum += a[k][i] * a[k][j];
        return sum;
    }
};

/// tr(G λ).
template <class Type>
[[gnu::always_inline]] inline double weighted_trace(const Corner<Type::dimension>& corner) {
    constexpr int d = Type::dimension;
    double own = 0.0, mixed = 0.0;
    for (int i = 0; i < d; ++i) own += Type::gram[i][i] * corner.lambda(i, i);
    for (int i = 0; i < d * (d - 1) / 2; ++i) {  // the pairs 0 1, 1 2 and 2 0; nested loops would not be unrolled
        const int j = (i + 1) % d;
        mixed += 2.0 * Type::gram[i][j] * corner.lambda(i, j);
    }
    return own + mixed;
}

/// A nonzero number to divide by.
inline double at_least_smallest(double extent) { return extent > smallest ? extent : smallest; }

/// f_k of a corner with the determinant α_k; any finite number if α_k is 0.
template <class Type>
[[gnu::always_inline]] inline double shape_term(const Corner<Type::dimension>& corner, double determinant) {
    constexpr int d = Type::dimension;
    const double extent = at_least_smallest(std::abs(determinant));
    if constexpr (Type::formula == Formula::length) {
        return 1.0;
    } else if constexpr (Type::formula == Formula::mean_ratio) {
        const double mean = weighted_trace<Type>(corner) * (1.0 / d);
        if constexpr (d == 2) return mean * Type::ideal / extent;
        const double root = inverse_cube_root(extent * (1.0 / Type::ideal));
        return mean * root * root;
    } else {
        double lengths = std::sqrt(corner.lambda(0, 0) * corner.lambda(1, 1)) * Type::ideal;
        if constexpr (d == 2) return lengths / extent;
        lengths *= std::sqrt(corner.lambda(d - 1, d - 1));
        const double root = inverse_cube_root(extent / at_least_smallest(lengths));
        return root * root;
    }
}

/// Size, skew and Σ sign α (0 if it is not a number) of a cell, from Σ α, Σ f and Σ sign α of its n corners.
template <int n>
[[gnu::always_inline]] inline void judge_cell(double extent, double terms, double reference, double& size, double& skew,
                                              double& signs) {
    // min(|τ|, 1/|τ|) with the sign of τ, with one division
    const bool smaller = std::abs(extent) <= std::abs(reference);
    const double ratio = (smaller ? extent : reference) / (smaller ? reference : extent);
    const double shape = std::abs(signs) == n ? n / terms : 0.0;
    // x − x is 0 only for a finite x: positions that are not finite get the worst quality
    const bool valid = (extent - extent == 0.0) & (terms == terms) & (ratio == ratio);
    size = valid ? ratio : -infinity;
    skew = valid ? shape : -infinity;
    signs = valid ? signs : 0.0;
}

constexpr auto nothing = [](int, const auto&) {};

/// Judges `count` ≤ chunk cells. gather(k, jacobians) writes the Jacobians of their corners k; also(k, jacobians) can
/// use them.
template <class Type, class Gather, class Also = decltype(nothing)>
void judge_chunk(Gather&& gather, Index count, const double* __restrict reference, double* __restrict size,
                 double* __restrict skew, bool* __restrict inverted, const Also& also = nothing) {
    constexpr int n = static_cast<int>(Type::corners.size());
    Jacobians<Type::dimension> jacobians;
    alignas(64) double extent[chunk], terms[chunk], signs[chunk];  // Σ α, Σ f, Σ sign α
    for (int k = 0; k < n; ++k) {
        gather(k, jacobians);
        for (Index s = 0; s < count; ++s) {
            const Corner<Type::dimension> corner(jacobians, s);
            const double alpha = corner.determinant(), term = shape_term<Type>(corner, alpha);
            const double sign = (alpha > smallest ? 1.0 : 0.0) - (alpha < -smallest ? 1.0 : 0.0);
            signs[s] = k ? signs[s] + sign : sign;
            if constexpr (n == 1) {  // divisions take as long as everything else, and run in parallel with it
                judge_cell<n>(alpha, term, reference[s], size[s], skew[s], signs[s]);
            } else {
                extent[s] = k ? extent[s] + alpha : alpha;
                terms[s] = k ? terms[s] + term : term;
            }
        }
        also(k, jacobians);
    }
    for (Index s = 0; n > 1 && s < count; ++s)
        judge_cell<n>(extent[s], terms[s], reference[s], size[s], skew[s], signs[s]);
    for (Index s = 0; s < count; ++s) inverted[s] = signs[s] < n;
}

constexpr double flat_corner = 1e-6;  // of det / product of the edge lengths: flatter corners have no shape

/// d |det T|^(2/d) / |T|² of a corner relative to its state at rest; 1 if it is flat at rest.
template <int d>
[[gnu::always_inline]] inline double kept_shape(const Corner<d>& now, const Corner<d>& rest) {
    double inverse[d][d];  // det A₀ A₀⁻¹
    if constexpr (d == 1) {
        return 1.0;
    } else if constexpr (d == 2) {
        inverse[0][0] = rest.a[1][1], inverse[0][1] = -rest.a[0][1];
        inverse[1][0] = -rest.a[1][0], inverse[1][1] = rest.a[0][0];
    } else {
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 3; ++j) {
                const int a = (j + 1) % 3, b = (j + 2) % 3, c = (i + 1) % 3, e = (i + 2) % 3;
                inverse[i][j] = rest.a[a][c] * rest.a[b][e] - rest.a[a][e] * rest.a[b][c];
            }
    }
    double lengths = 1.0;
    for (int j = 0; j < d; ++j) lengths *= rest.lambda(j, j);
    const double before = rest.determinant();
    const bool flat = std::abs(before) <= flat_corner * std::sqrt(lengths);
    const double unit = 1.0 / (flat ? 1.0 : before);  // avoids a division by zero, which ends OpenFOAM
    double square = 0.0;
    for (int i = 0; i < d; ++i)
        for (int j = 0; j < d; ++j) {
            double entry = now.a[i][0] * inverse[0][j];
            for (int k = 1; k < d; ++k) entry += now.a[i][k] * inverse[k][j];
            entry *= unit;
            square += entry * entry;
        }
    const double grown = at_least_smallest(std::abs(now.determinant() * unit));
    square = at_least_smallest(square);
    double shape = d * grown / square;
    if constexpr (d == 3) {
        const double root = inverse_cube_root(grown);
        shape = d / (square * root * root);
    }
    return flat ? 1.0 : shape;
}

/// Π |a_k|² of the edges a_k.
template <int d>
[[gnu::always_inline]] inline double squared_lengths(const Corner<d>& corner) {
    double product = 1.0;
    for (int j = 0; j < d; ++j) product *= corner.lambda(j, j);
    return product;
}

/// The quality of one corner relative to its state at rest, from its shape; without branches, so that a loop over
/// corners fills registers.
template <class Type, int d = Type::dimension>
[[gnu::always_inline]] inline double corner_value(const Corner<d>& now, const Corner<d>& rest, double shape) {
    constexpr bool simplex = Type::nodes == d + 1, box = !simplex && Type::corners.size() == 1 << d;
    const double det = now.determinant(), whole = rest.determinant(), before = simplex ? 1.0 : squared_lengths<d>(rest);
    const bool flat = !simplex & (std::abs(whole) <= flat_corner * std::sqrt(before));
    const bool valid = !flat & (det * whole > smallest * whole * whole);
    const double tau = (valid ? det : 1.0) / (valid ? whole : 1.0);  // avoids a division by zero, which ends OpenFOAM
    double value = shape * std::sqrt(tau < 1.0 ? tau : 1.0 / tau);
    if constexpr (box) {
        const double oblique = 0.5 * logarithm(squared_lengths<d>(now) / (valid ? before : 1.0)) - logarithm(tau);
        value *= oblique > 0.0 ? exponential(-AngleLaw(oblique).value()) : 1.0;
    }
    return valid ? value : 0.0;
}

/// The comparison of a chunk's cells with their state at rest, corner after corner.
template <class Type>
struct Compared {
    using Moved = Jacobians<Type::dimension>;
    alignas(64) double shape[chunk], corner[chunk];  // of relative_shapes, and of corner_quality

    explicit Compared(Index count) {
        std::fill_n(shape, count, 1.0);  // min starts with the first corner: unset entries may be NaN
        std::fill_n(corner, count, infinity);
    }

    /// Adds one corner of `count` cells; with_corner: also for corner_quality.
    template <bool with_corner>
    void add(const Moved& moved, const Moved& rest, Index count) {
        constexpr int d = Type::dimension;
        alignas(64) double kept[chunk];
        if constexpr (Type::nodes != d + 1) {  // the relative shape of a simplex is that of its skew
            for (Index s = 0; s < count; ++s) kept[s] = kept_shape<d>({moved, s}, {rest, s});
            for (Index s = 0; s < count; ++s) shape[s] = shape[s] < kept[s] ? shape[s] : kept[s];
        }
        for (Index s = 0; with_corner && s < count; ++s) {
            const Corner<d> here(moved, s), there(rest, s);
            if constexpr (Type::nodes == d + 1) corner[s] = corner_value<Type>(here, there, kept_shape<d>(here, there));
            else kept[s] = corner_value<Type>(here, there, kept[s]);
        }
        for (Index s = 0; with_corner && Type::nodes != d + 1 && s < count; ++s)
            corner[s] = kept[s] < corner[s] ? kept[s] : corner[s];
    }
};

/// Calls f(first, count, compared) for the chunks of the cells of one block.
template <bool with_corner, class Type, class F>
void compare_rows(Matrix<const double> points, Matrix<const double> rest_points, Matrix<const Node> nodes, F&& f) {
    for_chunks(0, nodes.shape(0), [&](Index first, Index count) {
        const Rows rows(points, nodes, first, count);
        const auto now = from_points<Type>(points, count, rows.cells<Type>(), rows.inside);
        const auto before = from_points<Type>(rest_points, count, rows.cells<Type>(), rows.inside);
        Jacobians<Type::dimension> moved, rest;
        Compared<Type> compared(count);
        for (int k = 0; k < static_cast<int>(Type::corners.size()); ++k) {
            now(k, moved);
            before(k, rest);
            compared.template add<with_corner>(moved, rest, count);
        }
        f(first, count, compared);
    });
}

/// The relative shapes of cells, from their skews; `shape` is that of Compared.
template <class Type>
void relate(Index count, const double* skew, const double* rest_skew, const double* shape, double* shapes) {
    for (Index s = 0; s < count; ++s) {
        if constexpr (Type::nodes == Type::dimension + 1) {
            const double kept = skew[s] / rest_skew[s];
            shapes[s] = kept < 1.0 ? kept : 1.0;  // a shape better than at rest counts as the shape at rest
        } else {  // 0 or −∞ for cells that are partly inverted or have no position
            shapes[s] = skew[s] > 0.0 ? shape[s] : skew[s];
        }
    }
}

/// Judges the cells of one block; the state at rest is only needed for the members of `found` that may be null.
template <class Type>
void judge_rows(Matrix<const double> points, Matrix<const Node> nodes, const double* reference,
                Matrix<const double> rest_points, const double* rest_skew, Judgement found) {
    constexpr bool simplex = Type::nodes == Type::dimension + 1;
    for_chunks(0, nodes.shape(0), [&](Index first, Index count) {
        const Rows rows(points, nodes, first, count);
        const auto now = from_points<Type>(points, count, rows.cells<Type>(), rows.inside);
        const auto before = from_points<Type>(rest_points, count, rows.cells<Type>(), rows.inside);
        Compared<Type> compared(count);
        Jacobians<Type::dimension> rest;
        const auto compare = [&](int k, const Jacobians<Type::dimension>& moved) {
            if (!found.corner && (simplex || !found.relative)) return;
            before(k, rest);
            if (found.corner) compared.template add<true>(moved, rest, count);
            else compared.template add<false>(moved, rest, count);
        };
        const Judgement here = found.from(first);
        judge_chunk<Type>(now, count, reference + first, here.size, here.skew, here.inverted, compare);
        if (found.relative) relate<Type>(count, here.skew, rest_skew + first, compared.shape, here.relative);
        if (found.corner) std::copy_n(compared.corner, count, here.corner);
    });
}

void require_results(Index m, Vector<const double> reference, Vector<double> size, Vector<double> skew,
                     Vector<bool> inverted) {
    require(reference.size() == m && size.size() == m && skew.size() == m && inverted.size() == m,
            "reference, size, skew, inverted: expected one entry for each cell");
}

constexpr double margin = 1.0 + 1e-9;  // of a comparison of sixth powers whose terms are rounded some thirty times
constexpr double tiny = 1e-280;        // smaller products may have too few digits

/// Whether the sixth power of a tetrahedron's size-skew is above the bound, for both ratios of its size.
[[gnu::always_inline]] inline bool surely_above(double det, double q, double whole, double bound) {
    const double own = det * det * det, reference = whole * whole * whole, cube = q * q * q;
    const double t2 = det * (1.0 / Tetra::ideal) * (det * (1.0 / Tetra::ideal));
    const double above = 729.0 * t2 * t2, least = bound * cube * cube;
    const bool grown = above * reference > least * own, shrunk = above * own > least * reference;
    return grown & shrunk & (least * own > tiny) & (least * reference > tiny);
}

/// Whether corner_quality of a tetrahedron is surely above a limit: with τ = det T, v⁶ = 729 τ⁴ min(τ, 1/τ)³ / |T|¹² is
/// above `bound` for both ratios.
[[gnu::always_inline]] inline bool corner_surely_above(const Corner<3>& now, const Corner<3>& rest, double bound) {
    double square = 0.0;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) {
            double entry = 0.0;
            for (int k = 0; k < 3; ++k) {
                const int a = (j + 1) % 3, b = (j + 2) % 3, c = (k + 1) % 3, e = (k + 2) % 3;
                entry += now.a[i][k] * (rest.a[a][c] * rest.a[b][e] - rest.a[a][e] * rest.a[b][c]);
            }
            square += entry * entry;
        }
    const double unit = 1.0 / rest.determinant(), tau = now.determinant() * unit;
    const double root = square * unit * unit, sixth = root * root * root * (root * root * root) * bound;
    const double power = tau * tau * tau;
    return (729.0 * tau > sixth) & (729.0 * tau * power * power > sixth);
}

}  // namespace

Cells::Cells(Matrix<const double> points, std::vector<Matrix<const Node>> blocks, Vector<const double> reference,
             AtRest rest)
    : points_(points), reference_(reference), rest_(rest) {
    Index first = 0;
    for (const auto& nodes : blocks) {
        with_cell_type(points.shape(1), nodes.shape(1), [&](auto type) {
            blocks_.push_back({nodes, first, judge_rows<decltype(type)>});
        });
        first += nodes.shape(0);
    }
    require(reference.size() == first, "reference: expected one entry for each cell");
    require(rest.skews.size() == first || rest.skews.size() == 0, "rest: expected one entry for each cell, or none");
    require(!has_rest() || rest.points.shape() == points.shape(), "rest: expected the points at rest too");
}

template <class F>
void Cells::by_block(Index first, Index last, F&& f) const {
    for (const Block& block : blocks_) {
        const Index from = std::max(first, block.first), to = std::min(last, block.first + block.nodes.shape(0));
        if (from < to) f(block, from, to);
    }
}

void Cells::judge(Index first, Index last, Judgement found) const {
    by_block(first, last, [&](const Block& block, Index from, Index to) {
        const auto nodes = block.nodes.rows(from - block.first, to - block.first);
        const double* rest = has_rest() ? rest_.skews.data() + from : nullptr;
        block.judge(points_, nodes, reference_.data() + from, rest_.points, rest, found.from(from - first));
    });
}

void Cells::judge_chosen(Vector<const Index> numbers, Judgement found) const {
    std::vector<Node> nodes;
    std::vector<double> reference, rest;
    const Index* at = numbers.begin();
    for (const Block& block : blocks_) {
        const Index beyond = block.first + block.nodes.shape(0);
        const Index* end = std::lower_bound(at, static_cast<const Index*>(numbers.end()), beyond);
        nodes.clear();
        reference.clear();
        rest.clear();
        for (const Index* number = at; number < end; ++number) {
            const auto row = block.nodes[*number - block.first];
            nodes.insert(nodes.end(), row.begin(), row.end());
            reference.push_back(reference_[*number]);
            if (found.relative) rest.push_back(rest_.skews[*number]);
        }
        const Matrix<const Node> rows(nodes.data(), {end - at, block.nodes.shape(1)});
        block.judge(points_, rows, reference.data(), rest_.points, rest.data(), found.from(at - numbers.begin()));
        at = end;
    }
}

/// With v = √size · skew and skew³ = 27 (det / det W)² / q³ (2.14), v⁶ > limit⁶ is two comparisons without roots or
/// divisions, one for each of the two ratios of which the smaller is the size. A margin far above the rounding keeps
/// the answer true for the computed values; products outside the range of doubles are never above. Relative to the
/// skews at rest: above the limit times that skew, and the size above limit².
Index Cells::mark_near(Index first, Index last, Metric metric, double limit, double corner_limit, Index* near) const {
    const bool relative = metric == Metric::relative_size_skew;
    Index found = 0;
    by_block(first, last, [&](const Block& block, Index from, Index to) {
        Index* marks = near + (from - first);
        const Index count = to - from;
        if (block.nodes.shape(1) != Tetra::nodes || points_.shape(1) != 3 || !(limit > 0.0) ||
            !(relative || metric == Metric::size_skew)) {
            std::fill_n(marks, count, 1);
            found += count;
            return;
        }
        Jacobians<3> jacobians;
        const Rows rows(points_, block.nodes, from - block.first, count);
        from_points<Tetra>(points_, count, rows.cells<Tetra>(), rows.inside)(0, jacobians);
        const double* reference = reference_.data() + from;
        const double square = limit * limit * margin, bound = limit * limit * limit * (limit * limit * limit) * margin;
        const auto mark = [&](auto is_relative, const double* rest) {
            for (Index s = 0; s < count; ++s) {
                const Corner<3> corner(jacobians, s);
                const double det = corner.determinant(), whole = reference[s], q = weighted_trace<Tetra>(corner);
                double own = bound;
                bool above = true;
                if constexpr (is_relative) {
                    const double squared = rest[s] * rest[s];
                    own *= squared * squared * squared;
                    above = (det > square * whole) & (whole > square * det);
                }
                marks[s] = !(above & surely_above(det, q, whole, own));
            }
        };
        if (relative)
            mark(std::true_type{}, rest_.skews.data() + from);
        else
            mark(std::false_type{}, nullptr);
        if (corner_limit > 0.0) {
            Jacobians<3> before;
            from_points<Tetra>(rest_.points, count, rows.cells<Tetra>(), rows.inside)(0, before);
            const double third = corner_limit * corner_limit * corner_limit, least = third * third * margin;
            for (Index s = 0; s < count; ++s) marks[s] |= !corner_surely_above({jacobians, s}, {before, s}, least);
        }
        found = std::accumulate(marks, marks + count, found);
    });
    return found;
}

void metric_of(Metric metric, Index count, const double* size, const double* skew, const double* relative,
               double* values) {
    const auto fill = [&]<Metric which>() {
        const double* shape = which == Metric::relative_size_skew ? relative : skew;
        for (Index s = 0; s < count; ++s) values[s] = metric_value<which>(size[s], shape[s]);
    };
    switch (metric) {
        case Metric::size: return fill.template operator()<Metric::size>();
        case Metric::skew: return fill.template operator()<Metric::skew>();
        case Metric::size_skew: return fill.template operator()<Metric::size_skew>();
        case Metric::size_skew_root: return fill.template operator()<Metric::size_skew_root>();
        case Metric::size_skew_product: return fill.template operator()<Metric::size_skew_product>();
        case Metric::relative_size_skew: return fill.template operator()<Metric::relative_size_skew>();
    }
    throw std::invalid_argument("metric: expected a number from 0 to 5");
}

void cell_sizes(Matrix<const double> points, Matrix<const Node> nodes, Vector<double> sizes) {
    require(sizes.size() == nodes.shape(0), "sizes: expected one entry for each cell");
    with_cell_type(points.shape(1), nodes.shape(1), [&]<class Type>(Type) {
        for_ranges(sizes.size(), judged_at_once, [&](Index begin, Index end) {
            for_chunks(begin, end, [&](Index first, Index count) {
                const Rows rows(points, nodes, first, count);
                const auto gather = from_points<Type>(points, count, rows.cells<Type>(), rows.inside);
                Jacobians<Type::dimension> jacobians;
                std::fill_n(&sizes[first], count, 0.0);
                for (int k = 0; k < static_cast<int>(Type::corners.size()); ++k) {
                    gather(k, jacobians);
                    for (Index s = 0; s < count; ++s)
                        sizes[first + s] += Corner<Type::dimension>(jacobians, s).determinant();
                }
            });
        });
    });
}

void cell_quality(Matrix<const double> points, Matrix<const Node> nodes, Vector<const double> reference,
                  Vector<double> size, Vector<double> skew, Vector<bool> inverted) {
    require_results(nodes.shape(0), reference, size, skew, inverted);
    with_cell_type(points.shape(1), nodes.shape(1), [&]<class Type>(Type) {
        for_ranges(nodes.shape(0), judged_at_once, [&](Index first, Index last) {
            judge_rows<Type>(points, nodes.rows(first, last), reference.data() + first, {}, nullptr,
                             Judgement{size.data(), skew.data(), inverted.data()}.from(first));
        });
    });
}

void relative_shapes(Matrix<const double> points, Matrix<const double> rest_points, Matrix<const Node> nodes,
                     Vector<const double> skew, Vector<const double> rest_skew, Vector<double> shapes) {
    const Index m = nodes.shape(0);
    require(skew.size() == m && rest_skew.size() == m && shapes.size() == m, "expected one entry for each cell");
    require(rest_points.shape() == points.shape(), "rest_points: expected the shape of points");
    with_cell_type(points.shape(1), nodes.shape(1), [&]<class Type>(Type) {
        for_ranges(m, judged_at_once, [&](Index first, Index last) {
            const auto own = [&, start = first](Index place, Index count, const Compared<Type>& compared) {
                const Index at = start + place;
                relate<Type>(count, &skew[at], &rest_skew[at], compared.shape, &shapes[at]);
            };
            compare_rows<false, Type>(points, rest_points, nodes.rows(first, last), own);
        });
    });
}

void corner_quality(Matrix<const double> points, Matrix<const double> rest_points, Matrix<const Node> nodes,
                    Vector<double> quality) {
    const Index m = nodes.shape(0);
    require(quality.size() == m, "quality: expected one entry for each cell");
    require(rest_points.shape() == points.shape(), "rest_points: expected the shape of points");
    with_cell_type(points.shape(1), nodes.shape(1), [&]<class Type>(Type) {
        for_ranges(m, judged_at_once, [&](Index first, Index last) {
            const auto own = [&, start = first](Index place, Index count, const Compared<Type>& compared) {
                std::copy_n(compared.corner, count, &quality[start + place]);
            };
            compare_rows<true, Type>(points, rest_points, nodes.rows(first, last), own);
        });
    });
}

void transformed_quality(Matrix<const double> points, Matrix<const Node> nodes, Vector<const double> reference,
                         Cube<const double> gradients, Vector<double> size, Vector<double> skew,
                         Vector<bool> inverted) {
    const Index dimension = points.shape(1);
    require_results(nodes.shape(0), reference, size, skew, inverted);
    require(gradients.shape() == std::array{nodes.shape(0), dimension, dimension},
            "gradients: expected a (d, d) matrix for each cell");
    with_cell_type(dimension, nodes.shape(1), [&]<class Type>(Type) {
        constexpr int d = Type::dimension;
        for_ranges(nodes.shape(0), judged_at_once, [&](Index begin, Index end) {
            for_chunks(begin, end, [&](Index first, Index count) {
                const Rows rows(points, nodes, first, count);
                const auto before = from_points<Type>(points, count, rows.cells<Type>(), rows.inside);
                const auto after = [&](int k, Jacobians<d>& jacobians) {
                    before(k, jacobians);
                    for (Index s = 0; s < count; ++s) {
                        const double* gradient = gradients.data() + (first + s) * d * d;
                        const Corner<d> corner(jacobians, s);
                        for (int i = 0; i < d; ++i)
                            for (int j = 0; j < d; ++j)
                                for (int l = 0; l < d; ++l)
                                    jacobians.entry[i][j][s] += gradient[i * d + l] * corner.a[l][j];
                    }
                };
                judge_chunk<Type>(after, count, reference.data() + first, &size[first], &skew[first],
                                  &inverted[first]);
            });
        });
    });
}

void column_quality(Matrix<const double> edges, Cube<const Index> columns, Vector<const double> reference,
                    Vector<double> size, Vector<double> skew, Vector<bool> inverted) {
    require_results(columns.shape(0), reference, size, skew, inverted);
    require(columns.shape(2) == edges.shape(1), "columns: expected an edge for each dimension");
    bool found = true;
    for (Index column : columns) found &= 1 <= std::abs(column) && std::abs(column) <= edges.shape(0);
    require(found, "columns: expected numbers of edges, from 1 on");
    const auto judge = [&]<class Type>(Type) {
        constexpr int d = Type::dimension;
        if (d != edges.shape(1) || Index(Type::corners.size()) != columns.shape(1)) return false;
        for_ranges(columns.shape(0), judged_at_once, [&](Index begin, Index end) {
            for_chunks(begin, end, [&](Index first, Index count) {
                const auto gather = [&](int k, Jacobians<d>& jacobians) {
                    for (Index s = 0; s < count; ++s)
                        for (int j = 0; j < d; ++j) {
                            const Index column = columns(first + s, k, j);
                            for (int i = 0; i < d; ++i) {
                                const double value = edges(std::abs(column) - 1, i);
                                jacobians.entry[i][j][s] = column > 0 ? value : -value;
                            }
                        }
                };
                judge_chunk<Type>(gather, count, reference.data() + first, &size[first], &skew[first],
                                  &inverted[first]);
            });
        });
        return true;
    };
    // the number of corners distinguishes the types of one dimension, too
    require(judge(Line{}) || judge(Triangle{}) || judge(Quad{}) || judge(Tetra{}) || judge(Hexahedron{}) ||
                judge(Wedge{}) || judge(Pyramid{}),
            "columns: no cell type has so many corners in this dimension");
}

void metric_values(Vector<const double> size, Vector<const double> skew, Index metric, Vector<double> values) {
    require(skew.size() == size.size() && values.size() == size.size(), "size, skew, values: expected one length");
    for_ranges(size.size(), 4 * judged_at_once, [&](Index first, Index last) {
        metric_of(static_cast<Metric>(metric), last - first, &size[first], &skew[first], &skew[first], &values[first]);
    });
}

}  // namespace mesh_motion
