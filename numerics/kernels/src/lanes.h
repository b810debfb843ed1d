// Sums in a fixed order for any vector width: eight partial sums, added in pairs.
#pragma once

#include "view.h"

namespace mesh_motion {

/// Partial sums of a reduction: one register of AVX-512, two of AVX, four of SSE2.
inline constexpr Index lanes = 8;

/// Numbers in one vector register. No result may depend on it.
#if defined(__AVX512F__)
inline constexpr Index register_lanes = 8;
#elif defined(__AVX__)
inline constexpr Index register_lanes = 4;
#else
inline constexpr Index register_lanes = 2;
#endif

/// Eight partial sums.
struct Lanes {
    double part[lanes] = {};

    double total() const {
        return ((part[0] + part[4]) + (part[2] + part[6])) + ((part[1] + part[5]) + (part[3] + part[7]));
    }
};

/// Σ term(j) for first ≤ j < last: term j goes to lane (j − first) mod 8.
template <class Term>
inline double sum_in_lanes(Index first, Index last, Term&& term) {
    Lanes sums;
    Index j = first;
    for (; j + lanes <= last; j += lanes)
        for (Index l = 0; l < lanes; ++l) sums.part[l] += term(j + l);
    for (Index l = 0; j < last; ++j, ++l) sums.part[l] += term(j);
    return sums.total();
}

}  // namespace mesh_motion
