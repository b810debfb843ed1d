#include "bind.h"
#include "quality/cell_bounds.h"
#include "quality/cell_order.h"
#include "quality/inversion.h"
#include "quality/order_statistics.h"
#include "quality/summaries.h"

#ifdef NB_TYPE_CASTER  // without nanobind recorded calls are repeated: tests/kernels/replay
/// The state at rest is passed as (skews, points).
template <>
struct nanobind::detail::type_caster<mesh_motion::AtRest> {
    using Both = std::pair<mesh_motion::Vector<const double>, mesh_motion::Matrix<const double>>;
    NB_TYPE_CASTER(mesh_motion::AtRest, make_caster<Both>::Name)

    bool from_python(handle source, std::uint32_t flags, cleanup_list* cleanup) noexcept {
        if (!both_.from_python(source, flags, cleanup)) return false;
        const Both both = both_.operator Both();
        value = {both.first, both.second};
        return true;
    }

  private:
    make_caster<Both> both_;  // keeps the memory during the call
};
#endif

namespace mesh_motion {

void bind_quality(nanobind::module_& m) {
    bind(m, "cell_sizes", cell_sizes);
    bind(m, "cell_quality", cell_quality);
    bind(m, "relative_shapes", relative_shapes);
    bind(m, "corner_quality", corner_quality);
    bind(m, "transformed_quality", transformed_quality);
    bind(m, "column_quality", column_quality);
    bind(m, "metric_values", metric_values);
    bind(m, "lowest_cells", lowest_cells);
    bind(m, "judged_cells", judged_cells);
    bind(m, "values_of_cells", values_of_cells);
    bind(m, "values_along", values_along);
    bind(m, "counted_cells", counted_cells);
    bind(m, "counts_in_parts", counts_in_parts);
    bind(m, "values_at", values_at);
    bind(m, "distribution", distribution);
    bind(m, "smallest_values", smallest_values);
    bind(m, "count_in_bins", count_in_bins);
    bind(m, "values_in_bin", values_in_bin);
    bind(m, "bounded_quality", bounded_quality);
    bind(m, "first_inversions", first_inversions);
    bind(m, "sort_cells", sort_cells<std::int32_t>);
    bind(m, "sort_cells", sort_cells<Index>);
    bind(m, "first_row_with_repetition", first_row_with_repetition);
}

}  // namespace mesh_motion
