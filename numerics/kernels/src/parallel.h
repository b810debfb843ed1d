// Loops over blocks on a few threads. Results do not depend on the thread that computes a block: callers fix the
// blocks.
#pragma once

#include <algorithm>

#include "view.h"

namespace mesh_motion {

/// Size of a cache line in bytes: data that two threads write all the time should not share one.
inline constexpr std::size_t cache_line = 64;

/// Number of threads that this process may use: MESH_MOTION_THREADS, or the cores it may run on.
int available_threads();
/// Number of threads for the loops of the calling thread; all available ones until set.
int get_threads();
/// Limits the calling thread's loops to 1 … available_threads().
void set_threads(int threads);

/// Calls task(context, block) for every block in 0 … count − 1 and waits. The first exception is thrown again.
void run_blocks(Index count, void* context, void (*task)(void*, Index));

/// Calls f(block) for every block.
template <class F>
void for_blocks(Index count, F&& f) {
    run_blocks(count, &f, [](void* context, Index block) { (*static_cast<std::remove_reference_t<F>*>(context))(block); });
}

/// Calls f(first, last) for parts of 0 … n − 1 of `size` each.
template <class F>
void for_ranges(Index n, Index size, F&& f) {
    for_blocks((n + size - 1) / size, [&](Index block) { f(block * size, std::min(n, (block + 1) * size)); });
}

/// Adds one to a counter shared by the threads of a loop; returns the old value, which depends on the order of the
/// threads.
inline Index count_one(Index& number) { return __atomic_fetch_add(&number, 1, __ATOMIC_RELAXED); }

}  // namespace mesh_motion
