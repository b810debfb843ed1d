#include "bind.h"
#include "interpolation/assembly.h"
#include "interpolation/background_grid.h"
#include "interpolation/basis.h"
#include "interpolation/cell_lists.h"
#include "interpolation/expansion.h"
#include "interpolation/sparse.h"
#include "interpolation/summation.h"

namespace mesh_motion {

void bind_interpolation(nanobind::module_& m) {
    const auto parts = [](CentreLayout made) {
        return std::make_tuple(std::move(made.order), std::move(made.coordinates), std::move(made.origin),
                               made.inverse_side, made.extent, std::move(made.shape), std::move(made.starts),
                               made.fraction);
    };
    bind(m, "lay_out_centres",
         [parts](Matrix<const double> points, double reach) { return parts(lay_out_centres(points, reach)); });
    bind(m, "lay_out_on_grid",
         [parts](Matrix<const double> points, Vector<const double> origin, double inverse_side, double extent,
                 Vector<const Index> shape) {
             return parts(lay_out_on_grid(points, origin, inverse_side, extent, shape));
         });
    bind(m, "mark_neighbours", mark_neighbours);
    bind(m, "mark_reached", mark_reached);
    bind(m, "mark_stencils", mark_stencils);
    bind(m, "interpolate_on_grid", interpolate_on_grid);
    bind(m, "map_phi", map_phi);
    bind(m, "map_slope", map_slope);
    bind(m, "sum_values", sum_values);
    bind(m, "sum_gradients", sum_gradients);
    bind(m, "fill_block", fill_block);
    bind(m, "rows_near", rows_near);
    bind(m, "count_near", count_near);
    bind(m, "near_rows", near_rows);
    bind(m, "add_product", add_product);
    bind(m, "transposed_product", transposed_product);
    bind(m, "solve_sparse", solve_sparse);
    bind(m, "column_products", column_products);
    bind(m, "advance_columns", advance_columns);
    bind(m, "redirect_columns", redirect_columns);
    bind(m, "sparse_inverse_rows", sparse_inverse_rows);
    bind(m, "expand", expand);
    bind(m, "sum_remainders", sum_remainders);
}

}  // namespace mesh_motion
