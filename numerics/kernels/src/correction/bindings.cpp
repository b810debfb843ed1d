#include "bind.h"
#include "correction/block_cholesky.h"
#include "correction/cells.h"
#include "correction/distortion.h"
#include "correction/newton.h"
#include "correction/region.h"

namespace mesh_motion {

void bind_correction(nanobind::module_& m) {
    bind(m, "add_cells", add_cells);
    bind(m, "add_corners", add_corners);
    bind(m, "add_linked_blocks", add_linked_blocks);
    bind(m, "add_penalty", add_penalty);
    bind(m, "assemble_corners", assemble_corners);
    bind(m, "block_cholesky", block_cholesky);
    bind(m, "block_cholesky_solve", block_cholesky_solve);
    bind(m, "block_conjugate_gradients", block_conjugate_gradients);
    bind(m, "block_product", block_product);
    bind(m, "cell_adjacency", cell_adjacency);
    bind(m, "cell_blocks", cell_blocks);
    bind(m, "cell_distortions", cell_distortions);
    bind(m, "cell_gradients", cell_gradients);
    bind(m, "corner_blocks", corner_blocks);
    bind(m, "corner_hessians", corner_hessians);
    bind(m, "corner_maps", corner_maps);
    bind(m, "determinants", determinants);
    bind(m, "distortion_gradients", distortion_gradients);
    bind(m, "distortions", distortions);
    bind(m, "elimination", elimination);
    bind(m, "gather_shares", gather_shares);
    bind(m, "linked_pattern", linked_pattern);
    bind(m, "node_adjacency", node_adjacency);
    bind(m, "node_aggregates", node_aggregates);
    bind(m, "p_mean", p_mean);
    bind(m, "touched_cells", touched_cells);
}

}  // namespace mesh_motion
