// What Python sees of far fields, of two scales and of grids.
#include "bind.h"
#include "far_field/background_grid.h"
#include "far_field/box_tree.h"
#include "far_field/cell_lists.h"
#include "far_field/chebyshev.h"
#include "far_field/group_sums.h"
#include "far_field/plan.h"
#include "two_scale/coarse_points.h"
#include "two_scale/grid_sums.h"
#include "two_scale/spline.h"

namespace mesh_motion {

void bind_far_field(nanobind::module_& m) {
    bind(m, "lay_out_centres", [](Matrix<const double> points, double reach) {
        CentreLayout made = lay_out_centres(points, reach);
        return std::make_tuple(std::move(made.order), std::move(made.coordinates), std::move(made.origin),
                               made.inverse_side, std::move(made.shape), std::move(made.starts), made.fraction);
    });
    bind(m, "mark_neighbours", mark_neighbours);
    bind(m, "mark_reached", mark_reached);
    bind(m, "mark_stencils", mark_stencils);
    bind(m, "interpolate_on_grid", interpolate_on_grid);

    bind(m, "build_box_tree", build_box_tree);
    bind(m, "plan_far_field", plan_far_field);
    bind(m, "sum_groups", sum_groups);
    bind(m, "box_points", box_points);
    bind(m, "carry_down", carry_down);
    bind(m, "add_polynomials", add_polynomials);

    bind(m, "drop_followers", drop_followers);
    bind(m, "choose_farthest", choose_farthest);
    bind(m, "sum_on_grid", sum_on_grid);
    bind(m, "spline_values", spline_values);
    bind(m, "spline_gradients", spline_gradients);
    bind(m, "quasi_interpolate", quasi_interpolate);
    bind(m, "blend_with_parent", blend_with_parent);
}

}  // namespace mesh_motion
