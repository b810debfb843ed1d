// Relative size and skew of cells, from the positions of their nodes or from data of their edges.
#pragma once

#include <bit>
#include <cmath>

#include "quality/cell_types.h"
#include "view.h"

namespace mesh_motion {

/// Number of cells that are judged side by side: the Jacobians of one corner of 128 cells are 9 KiB.
inline constexpr Index chunk = 128;
/// Number of cells in one task; fixed, so that no result depends on the number of threads.
inline constexpr Index judged_at_once = 64 * chunk;

/// Quality metrics, numbered as in numerics/quality/metrics.py.
enum class Metric : Index { size, skew, size_skew, size_skew_root, size_skew_product, relative_size_skew };

/// One quality metric of one cell; for the relative metric with the cell's relative shape; −∞ stays −∞.
template <Metric metric>
inline double metric_value(double size, double skew) {
    if constexpr (metric == Metric::size) return size;
    if constexpr (metric == Metric::skew) return skew;
    const double grown = std::abs(size);
    double value;
    if constexpr (metric == Metric::size_skew_root)
        value = std::sqrt(grown * skew);
    else if constexpr (metric == Metric::size_skew_product)
        value = grown * skew;
    else
        value = std::sqrt(grown) * skew;
    value = size > 0.0 ? value : -value;
    return grown <= 1.0 ? value : size;
}

/// values[s] of the metric, from size[s] and skew[s], or for the relative metric from relative[s].
void metric_of(Metric metric, Index count, const double* size, const double* skew, const double* relative,
               double* values);

/// The state at rest for the relative metric: the skews (m,) at rest of all cells, of which those of simplices are
/// read, and the positions (n, d) at rest. Both empty if only other metrics are used.
struct AtRest {
    Vector<const double> skews;
    Matrix<const double> points;
};

/// x^(−1/3) of x > 10⁻²⁹⁰ to 2 ulp, without a division: y ← y (1 − e)^(−1/3) for e = 1 − x y³, to the third order in e.
inline double inverse_cube_root(double x) {
    // the leading half of x's bits, divided by −3, gives an estimate of the root's bits with an error of at most 3.5 %
    const std::uint64_t third = (std::bit_cast<std::uint64_t>(x) >> 32) * 0x55555556u >> 32;
    const double y = std::bit_cast<double>((0x553ee8b4u - third) << 32);
    const auto better = [x](double y) {
        const double e = 1.0 - x * y * y * y;
        return y + y * (e * (1.0 / 3.0 + e * (2.0 / 9.0 + e * (14.0 / 81.0))));
    };
    return better(better(y));
}

/// Memory for the size, skew and validity of cells, and, if they are not null, their relative shapes and the quality of
/// their worst corners.
struct Judgement {
    double* size;
    double* skew;
    bool* inverted;
    double* relative = nullptr;
    double* corner = nullptr;

    /// The places from the cell `first` on.
    Judgement from(Index first) const {
        return {size + first, skew + first, inverted + first, relative ? relative + first : nullptr,
                corner ? corner + first : nullptr};
    }
};

/// Judges cells of several blocks with consecutive numbers.
class Cells {
  public:
    /// The nodes (m_i, k) of each block into points (n, d), reference (m,) sizes, and the state at rest or nothing.
    Cells(Matrix<const double> points, std::vector<Matrix<const Node>> blocks, Vector<const double> reference,
          AtRest rest);

    Index size() const { return reference_.size(); }
    bool has_rest() const { return rest_.skews.size() == size(); }

    /// Judges the cells first … last − 1.
    void judge(Index first, Index last, Judgement found) const;
    /// Judges cells with ascending numbers.
    void judge_chosen(Vector<const Index> numbers, Judgement found) const;
    /// near[s]: whether the metric of the cell first + s may be at most the limit, or corner_quality at most
    /// corner_limit; returns the number of such cells, of at most `chunk` cells. All are marked if the check costs as
    /// much as judging.
    Index mark_near(Index first, Index last, Metric metric, double limit, double corner_limit, Index* near) const;

  private:
    struct Block {
        Matrix<const Node> nodes;
        Index first;
        void (*judge)(Matrix<const double>, Matrix<const Node>, const double*, Matrix<const double>, const double*,
                      Judgement);
    };
    /// Calls f(block, first, last) for the cells of each block among the cells first … last − 1.
    template <class F>
    void by_block(Index first, Index last, F&& f) const;

    Matrix<const double> points_;
    std::vector<Block> blocks_;
    Vector<const double> reference_;
    AtRest rest_;
};

/// sizes (m,) = Σ_k det A_k of each cell.
void cell_sizes(Matrix<const double> points, Matrix<const Node> nodes, Vector<double> sizes);

/// Size, skew and inverted (m,) of each cell from its nodes (m, k) and reference sizes (m,).
void cell_quality(Matrix<const double> points, Matrix<const Node> nodes, Vector<const double> reference,
                  Vector<double> size, Vector<double> skew, Vector<bool> inverted);

/// Shape (m,) of each cell relative to that at rest, from its nodes (m, k), its skew now and at rest (m,): for
/// simplices min(1, skew / skew at rest), for others the smallest d |det T|^(2/d) / |T|² of T = A A₀⁻¹ over the
/// corners, with A₀ the corner at rest. A corner that is flat at rest is not compared.
void relative_shapes(Matrix<const double> points, Matrix<const double> rest_points, Matrix<const Node> nodes,
                     Vector<const double> skew, Vector<const double> rest_skew, Vector<double> shapes);

/// Quality (m,) of each cell's worst corner relative to its state at rest: d |det T|^(2/d) / |T|² as above, also for
/// simplices, times √min(τ, 1/τ) of τ = det T and, for quads and hexahedra, times exp(−φ) of angle_law.h; 0 or less if
/// it is inverted. exp(−f) is at least this for the distortion f of numerics/correction/smooth_motion.py. A corner that
/// is flat at rest has the value 0.
void corner_quality(Matrix<const double> points, Matrix<const double> rest_points, Matrix<const Node> nodes,
                    Vector<double> quality);

/// The same with every corner Jacobian A replaced by (I + J) A, J = gradients (m, d, d) of the cell.
void transformed_quality(Matrix<const double> points, Matrix<const Node> nodes, Vector<const double> reference,
                         Cube<const double> gradients, Vector<double> size, Vector<double> skew, Vector<bool> inverted);

/// The same from edge vectors (e, d): columns (m, corners, d) are ±(edge number + 1).
void column_quality(Matrix<const double> edges, Cube<const Index> columns, Vector<const double> reference,
                    Vector<double> size, Vector<double> skew, Vector<bool> inverted);

/// Values (m,) of a metric; the relative metric takes the relative shapes instead of the skews.
void metric_values(Vector<const double> size, Vector<const double> skew, Index metric, Vector<double> values);

}  // namespace mesh_motion
