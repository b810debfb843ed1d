// Loops over blocks on a few threads. Who does a block never changes its result: blocks are fixed by their callers.
#pragma once

#include <algorithm>

#include "view.h"

namespace mesh_motion {

/// Bytes that a processor core takes at once: what two threads write to all the time should not lie in the same ones.
inline constexpr std::size_t cache_line = 64;

/// Threads that this process may use: MESH_MOTION_THREADS, or the cores it may run on.
int available_threads();
/// Threads that the calling thread's loops use; all that are available until set.
int get_threads();
/// Limits the calling thread's loops to 1 … available_threads().
void set_threads(int threads);

/// Calls task(context, block) for every block in 0 … count − 1 and waits. The first exception is thrown again.
void run_blocks(Index count, void* context, void (*task)(void*, Index));

/// f(block) for every block.
template <class F>
void for_blocks(Index count, F&& f) {
    run_blocks(count, &f, [](void* context, Index block) { (*static_cast<std::remove_reference_t<F>*>(context))(block); });
}

/// f(first, last) for parts of 0 … n − 1 of `size` each.
template <class F>
void for_ranges(Index n, Index size, F&& f) {
    for_blocks((n + size - 1) / size, [&](Index block) { f(block * size, std::min(n, (block + 1) * size)); });
}

/// Adds one to a number that the threads of a loop count in; returns what it was, which depends on who came first.
inline Index count_one(Index& number) { return __atomic_fetch_add(&number, 1, __ATOMIC_RELAXED); }

}  // namespace mesh_motion
