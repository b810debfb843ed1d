// Chosen centres side by side, for sums over many short runs of them.
#pragma once

#include "interpolation/summation.h"

namespace mesh_motion {

class Gathered {
  public:
    /// Centres j of (3, nc) and their weights (k, nc), by which `each(add)` calls add(j), `count` times; filled up with
    /// centres of no weight, so that no sum ends within a vector.
    template <class Each>
    Gathered(Matrix<const double> centres, Matrix<const double> weights, Index count, Each&& each)
        : count_((count + lanes - 1) / lanes * lanes), k_(weights.shape(0)), numbers_((3 + k_) * count_) {
        Index at = 0;
        each([&](Index j) {
            for (Index m = 0; m < 3; ++m) numbers_[m * count_ + at] = centres(m, j);
            for (Index c = 0; c < k_; ++c) numbers_[(3 + c) * count_ + at] = weights(c, j);
            ++at;
        });
    }

    /// out (k) = Σ_j w_j φ(|x − x_j|/R).
    template <class Basis>
    void sum(const Point& x, double inverse_radius, Vector<double> out) const {
        const Matrix<const double> centres(numbers_.data(), {3, count_});
        const Matrix<const double> weights(numbers_.data() + 3 * count_, {k_, count_});
        sum_over<Basis>(x, std::array{Run{0, count_}}, centres, weights, inverse_radius, out);
    }

  private:
    Index count_, k_;
    std::vector<double> numbers_;
};

}  // namespace mesh_motion
