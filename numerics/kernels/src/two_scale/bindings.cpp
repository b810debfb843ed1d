#include "bind.h"
#include "two_scale/coarse_points.h"
#include "two_scale/grid_sums.h"
#include "two_scale/spline.h"

namespace mesh_motion {

void bind_two_scale(nanobind::module_& m) {
    bind(m, "drop_followers", drop_followers);
    bind(m, "choose_farthest", choose_farthest);
    bind(m, "sum_on_grid", sum_on_grid);
    bind(m, "sum_from_grid", sum_from_grid);
    bind(m, "spline_values", spline_values);
    bind(m, "spline_gradients", spline_gradients);
    bind(m, "add_spline_coefficients", add_spline_coefficients);
    bind(m, "quasi_interpolate", quasi_interpolate);
    bind(m, "blend_with_parent", blend_with_parent);
}

}  // namespace mesh_motion
