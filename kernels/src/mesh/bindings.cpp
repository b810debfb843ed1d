#include "bind.h"
#include "mesh/differences.h"

namespace mesh_motion {

void bind_mesh(nanobind::module_& m) {
    bind(m, "round_differences", round_differences);
    bind(m, "take_differences", take_differences);
}

}  // namespace mesh_motion
