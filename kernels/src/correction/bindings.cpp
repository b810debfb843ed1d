#include "bind.h"

namespace mesh_motion {

void bind_correction([[maybe_unused]] nanobind::module_& m) {}

}  // namespace mesh_motion
