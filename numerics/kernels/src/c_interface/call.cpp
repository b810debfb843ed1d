#include "c_interface/call.h"

#include <cstdio>

#include "parallel.h"

namespace mesh_motion {
namespace {

thread_local char last_error[512];

}  // namespace

void keep_error(const char* message) noexcept { std::snprintf(last_error, sizeof last_error, "%s", message); }

}  // namespace mesh_motion

const char* mesh_motion_kernels_error(void) { return mesh_motion::last_error; }

int mesh_motion_available_threads(void) { return mesh_motion::available_threads(); }

int mesh_motion_get_threads(void) { return mesh_motion::get_threads(); }

int mesh_motion_set_threads(int threads) {
    return mesh_motion::answered([&] { mesh_motion::set_threads(threads); });
}
