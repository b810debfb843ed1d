#include "bind.h"

namespace mesh_motion {

void bind_quality([[maybe_unused]] nanobind::module_& m) {}

}  // namespace mesh_motion
