// The basis functions of thesis Tables 2.1 and 2.2, and a sum of one, as inline functions of ξ = r/R.
//
// Each row of the tables is a type with φ(ξ) and the *slope* φ'(ξ)/ξ, which a gradient needs:
// ∇φ = slope(ξ) (x − x_j) / R². Both take ξ ≥ 0; compact ones are zero for ξ > 1. Terms with a logarithm take their
// limit at ξ = 0: zero for φ, and for the slopes that diverge there too (they multiply the vector x − x_j = 0).
// "(1 − ξ)" means max(0, 1 − ξ). The tables print the coefficient 20/3 of CTPS C1; the code has 80/3, because only with
// 80/3 is φ(1) = 0.
//
// The code has no branches and calls no library, so that the compiler makes vector instructions of any width from a
// loop over an array.
#pragma once

#include <algorithm>
#include <bit>
#include <cmath>
#include <tuple>

#include "view.h"

namespace mesh_motion {

/// log ξ, and 0 at ξ = 0: there every term that contains it has the limit 0 or multiplies a zero vector. The series of
/// (m − 1)/(m + 1) with the coefficients of FreeBSD's e_log.c; the error is below 1 ulp.
inline double logarithm(double xi) {
    // takes out a power of two so that √½ ≤ m < √2; root_half has the bits of √½
    constexpr std::uint64_t root_half = 0x3FE6A09E667F3BCD, mantissa = 52, bias = 1 << 11;
    // the first part of log 2 has few digits: its product with an exponent is exact
    constexpr double high = 6.93147180369123816490e-01, low = 1.90821492927058770002e-10;
    const auto bits = std::bit_cast<std::uint64_t>(xi);
    // exponent + bias ≥ 0 and small: it is written to the low bits of a double of size 2⁵² (some vector units do not
    // convert integers)
    const std::uint64_t raised = (bits - root_half + (bias << mantissa)) >> mantissa;
    const double exponent = std::bit_cast<double>(raised | std::uint64_t{0x4330000000000000}) - (0x1p52 + bias);
    const double f = std::bit_cast<double>(bits - ((raised - bias) << mantissa)) - 1.0;
    const double s = f / (2.0 + f), z = s * s, half = 0.5 * f * f;
    constexpr double series_of[] = {1.479819860511658591e-01, 1.531383769920937332e-01, 1.818357216161805012e-01,
                                    2.222219843214978396e-01, 2.857142874366239149e-01, 3.999999999940941908e-01,
                                    6.666666666666735130e-01};
    double series = 0.0;
    for (double coefficient : series_of) series = z * series + coefficient;
    series *= z;
    const double value = exponent * high - ((half - (s * (half + series) + exponent * low)) - f);
    return xi > 0.0 ? value : 0.0;
}

/// exp x for x ≤ 0, and 0 for x ≤ −708. S. L. Moshier, "Methods and Programs for Mathematical Functions", Ellis Horwood
/// 1989; the error is below 3 ulp.
inline double exponential(double x) {
    constexpr double smallest = -708.0, per_log_2 = 1.4426950408889634;
    constexpr double high = 6.93145751953125e-1, low = 1.42860682030941723212e-6;
    const double near = x > smallest ? x : smallest;
    constexpr double magic = 0x1.8p52;  // adding this number rounds to an integer, which is then in the low bits
    const double shifted = near * per_log_2 + magic, exponent = shifted - magic;
    const double r = (near - exponent * high) - exponent * low, z = r * r;
    const double p = r * ((1.26177193074810590878e-4 * z + 3.02994407707441961300e-2) * z + 9.99999999999999999910e-1);
    const double q =
        ((3.00198505138664455042e-6 * z + 2.52448340349684104192e-3) * z + 2.27265548208155028766e-1) * z + 2.0;
    const double power = std::bit_cast<double>((std::bit_cast<std::uint64_t>(shifted) + 1023) << 52);
    return x > smallest ? power * (1.0 + 2.0 * (p / (q - p))) : 0.0;
}

/// x to an integer power, by repeated squares.
template <int N>
constexpr double power(double x) {
    if constexpr (N == 1) {
        return x;
    } else {
        const double half = power<N / 2>(x);
        return N % 2 ? half * half * x : half * half;
    }
}

/// max(0, 1 − ξ).
inline double inside(double xi) { return std::max(1.0 - xi, 0.0); }

struct WendlandC2 {
    static double phi(double x) { return power<4>(inside(x)) * (4.0 * x + 1.0); }
    static double slope(double x) { return -20.0 * power<3>(inside(x)); }
};

struct WendlandC0 {
    static double phi(double x) { return power<2>(inside(x)); }
    static double slope(double x) { return x > 0.0 ? -2.0 * inside(x) / x : 0.0; }
};

/// Σ_k φ(2ᵏξ)/4ᵏ, k = 0 … 3, of Wendland's C2 function φ, by the sum of the weights.
struct WendlandC2Multiscale {
    static constexpr double share = 64.0 / 85.0;
    static double phi(double x) {
        const double near = WendlandC2::phi(4.0 * x) + 0.25 * WendlandC2::phi(8.0 * x);
        return share * (WendlandC2::phi(x) + 0.25 * (WendlandC2::phi(2.0 * x) + 0.25 * near));
    }
    static double slope(double x) {
        const double cubes = power<3>(inside(x)) + power<3>(inside(2.0 * x)) + power<3>(inside(4.0 * x));
        return -20.0 * share * (cubes + power<3>(inside(8.0 * x)));
    }
};

/// ξ ≤ 1 in the second factors avoids 0 · ∞.
struct WendlandC4 {
    static double phi(double xi) {
        const double x = std::min(xi, 1.0);
        return power<6>(1.0 - x) * ((35.0 / 3.0 * x + 6.0) * x + 1.0);
    }
    static double slope(double xi) {
        const double x = std::min(xi, 1.0);
        return -56.0 / 3.0 * power<5>(1.0 - x) * (5.0 * x + 1.0);
    }
};

struct WendlandC6 {
    static double phi(double xi) {
        const double x = std::min(xi, 1.0);
        return power<8>(1.0 - x) * (((32.0 * x + 25.0) * x + 8.0) * x + 1.0);
    }
    static double slope(double xi) {
        const double x = std::min(xi, 1.0);
        return -22.0 * power<7>(1.0 - x) * ((16.0 * x + 7.0) * x + 1.0);
    }
};

struct CtpsC0 {
    static double phi(double x) { return power<5>(inside(x)); }
    static double slope(double x) { return x > 0.0 ? -5.0 * power<4>(inside(x)) / x : 0.0; }
};

struct CtpsC1 {
    static double phi(double x) {
        const double value =
            1.0 + x * x * (80.0 / 3.0 + x * (-40.0 + x * (15.0 - 8.0 / 3.0 * x)) + 20.0 * logarithm(x));
        return x <= 1.0 ? value : 0.0;
    }
    static double slope(double x) {
        const double value = 220.0 / 3.0 + x * (-120.0 + x * (60.0 - 40.0 / 3.0 * x)) + 40.0 * logarithm(x);
        return 0.0 < x && x <= 1.0 ? value : 0.0;
    }
};

struct CtpsC2a {
    static double phi(double x) {
        const double value = 1.0 + x * x * (-30.0 + x * (-10.0 + x * (45.0 - 6.0 * x) - 60.0 * logarithm(x)));
        return x <= 1.0 ? value : 0.0;
    }
    static double slope(double x) {
        const double value = -60.0 + x * (-90.0 + x * (180.0 - 30.0 * x) - 180.0 * logarithm(x));
        return x <= 1.0 ? value : 0.0;
    }
};

struct CtpsC2b {
    static double phi(double x) {
        const double value = 1.0 + x * x * (-20.0 + x * (80.0 + x * (-45.0 - 16.0 * x + 60.0 * logarithm(x))));
        return x <= 1.0 ? value : 0.0;
    }
    static double slope(double x) {
        const double value = -40.0 + x * (240.0 + x * (-120.0 - 80.0 * x + 240.0 * logarithm(x)));
        return x <= 1.0 ? value : 0.0;
    }
};

struct ThinPlate {
    static double phi(double x) { return x * x * logarithm(x); }
    static double slope(double x) { return x > 0.0 ? 2.0 * logarithm(x) + 1.0 : 0.0; }
};

struct Multiquadric {
    static double phi(double x) { return std::sqrt(1.0 + x * x); }
    static double slope(double x) { return 1.0 / std::sqrt(1.0 + x * x); }
};

struct InverseMultiquadric {
    static double phi(double x) { return 1.0 / std::sqrt(1.0 + x * x); }
    static double slope(double x) {
        const double s = 1.0 + x * x;
        return -1.0 / (s * std::sqrt(s));
    }
};

struct Quadric {
    static double phi(double x) { return 1.0 + x * x; }
    static double slope(double) { return 2.0; }
};

struct InverseQuadric {
    static double phi(double x) { return 1.0 / (1.0 + x * x); }
    static double slope(double x) { return -2.0 / power<2>(1.0 + x * x); }
};

struct Gauss {
    static double phi(double x) { return exponential(-x * x); }
    static double slope(double x) { return -2.0 * exponential(-x * x); }
};

/// The basis functions by their codes; kernels.py maps names to codes.
using Bases = std::tuple<WendlandC2, WendlandC2Multiscale, WendlandC0, WendlandC4, WendlandC6, CtpsC0, CtpsC1, CtpsC2a,
                         CtpsC2b, ThinPlate, Multiquadric, InverseMultiquadric, Quadric, InverseQuadric, Gauss>;

/// Calls f(basis) with the type for this code: loops inside are compiled for each type.
template <class F>
void with_basis(int code, F&& f) {
    const auto try_all = [&]<std::size_t... I>(std::index_sequence<I...>) {
        return ((code == static_cast<int>(I) && (f(std::tuple_element_t<I, Bases>{}), true)) || ...);
    };
    require(try_all(std::make_index_sequence<std::tuple_size_v<Bases>>{}), "code: expected that of a basis function");
}

/// Replaces every ξ of xi by φ(ξ), for a basis that is chosen at run time.
void map_phi(int code, Vector<double> xi);
/// Replaces every ξ of xi by φ'(ξ)/ξ.
void map_slope(int code, Vector<double> xi);

}  // namespace mesh_motion
