// Eight corners or cells side by side, in vector registers of any width. Each lane has the same bits as a single corner
// or cell.
#pragma once

#include <array>
#include <cmath>
#include <utility>

#include "lanes.h"
#include "view.h"

namespace mesh_motion {

using Pack = double __attribute__((vector_size(lanes * sizeof(double))));
/// The result of a comparison of packs; as the condition of ?: it selects lane by lane.
using Mask = decltype(Pack{} < Pack{});

/// A d × d matrix in each lane, row by row.
template <int d>
using Small = std::array<std::array<Pack, d>, d>;

inline Pack all(double x) { return Pack{} + x; }

/// The pack of f(0) … f(7). Without the attribute the compiler calls f for each lane where it is used often. A build with
/// sanitizers leaves it out: with all checks inlined, one file compiles for ten minutes.
template <class F>
#ifndef MESH_MOTION_CHECKED
[[gnu::flatten]]
#endif
inline Pack gathered(F&& f) {
    return [&]<std::size_t... l>(std::index_sequence<l...>) {
        return Pack{f(static_cast<int>(l))...};
    }(std::make_index_sequence<lanes>{});
}

/// f of each lane. Through the array the compiler can make vector code of f.
template <class F>
inline Pack each(F&& f, Pack x) {
    alignas(Pack) double value[lanes];
    __builtin_memcpy(value, &x, sizeof x);
    for (double& v : value) v = f(v);
    __builtin_memcpy(&x, value, sizeof x);
    return x;
}

inline Pack root(Pack x) {
    return each([](double v) { return std::sqrt(v); }, x);
}
inline Pack size_of(Pack x) { return x < 0.0 ? -x : x; }
inline Pack larger(Pack x, Pack y) { return x > y ? x : y; }

inline bool any(Mask mask) {
    mask |= __builtin_shufflevector(mask, mask, 4, 5, 6, 7, 0, 1, 2, 3);
    mask |= __builtin_shufflevector(mask, mask, 2, 3, 0, 1, 6, 7, 4, 5);
    return mask[0] | mask[1];
}

}  // namespace mesh_motion
