#include "bind.h"

namespace mesh_motion {

void bind_interpolation([[maybe_unused]] nanobind::module_& m) {}

}  // namespace mesh_motion
