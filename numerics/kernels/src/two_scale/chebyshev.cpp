#include "two_scale/chebyshev.h"

namespace mesh_motion {
namespace {

/// The positive places of each order, exact to the last bit: computed cosines differ between machines.
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

    Tables() {
        for (int p = 1; p <= most_order; ++p)
            for (int i = 0; i < p; ++i) {
                double before = place_of(p, i), now = 1.0;  // T_−1 = T_1
                for (int m = 0; m < p; ++m) {
                    coefficients[p][m][i] = (m > 0 ? 2.0 : 1.0) / p * now;
                    before = std::exchange(now, 2.0 * place_of(p, i) * now - before);
                }
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

}  // namespace

double chebyshev_place(int order, int i) { return place_of(order, i); }

void lagrange_functions(double u, int order, std::array<double, most_order>& out) { tables().fill(u, order, out); }

}  // namespace mesh_motion
