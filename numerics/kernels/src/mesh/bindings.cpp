#include "bind.h"
#include "mesh/closest_point.h"
#include "mesh/contact.h"
#include "mesh/digest.h"
#include "mesh/facets.h"
#include "mesh/hashed_cells.h"
#include "mesh/near_facets.h"
#include "mesh/points.h"

namespace mesh_motion {

void bind_mesh(nanobind::module_& m) {
    bind(m, "add_values", add_values);
    bind(m, "bounding_box", corners_of);
    bind(m, "closest_points", closest_points);
    bind(m, "smooth_points", smooth_points);
    bind(m, "first_contact", first_contact);
    bind(m, "hash_blocks", hash_blocks);
    bind(m, "match_facets", match_facets);
    bind(m, "near_facets", near_facets);
    bind(m, "points_near_facets", points_near_facets);
    bind(m, "round_differences", round_differences);
    bind(m, "store_cells", [](Matrix<const double> points, Vector<const double> origin, double extent, double side) {
        StoredCells made = store_cells(points, origin, extent, side);
        return std::make_tuple(std::move(made.order), std::move(made.coordinates), std::move(made.origin),
                               made.inverse_side, std::move(made.keys), std::move(made.spans), std::move(made.runs));
    });
    bind(m, "take_differences", take_differences);
}

}  // namespace mesh_motion
