/* The compiled kernels of the mesh-motion server in C: interpolants and splines evaluated at points, cells judged.
 *
 *     mesh_motion_interpolant *field = NULL;
 *     mesh_motion_interpolant_create("wendland-c2", radius, 3, centres, control_points, 3, weights, &field);
 *     mesh_motion_interpolant_values(field, n, points, MESH_MOTION_WRITE, displacement);
 *     mesh_motion_interpolant_free(field);
 *
 * A call returns MESH_MOTION_OK or an error's number, and mesh_motion_kernels_error() then says what was expected.
 * After an error what a call writes to is unspecified; a handle is unchanged, and one that should have been made is
 * NULL. Handles copy the arrays that they are made of.
 *
 * Arrays are row-major: "points (n, d)" are the d coordinates of each of n points, one point after the other. An array
 * that is empty may be NULL. Nodes and cells count from 0. Lengths are in the mesh length unit, whatever it is.
 *
 * Results do not depend on the number of threads, on the instruction set, or on how points are split into calls: they
 * have the bits of the server. A handle may be evaluated by several threads at a time; it is made and freed by one.
 */
#ifndef MESH_MOTION_KERNELS_H
#define MESH_MOTION_KERNELS_H

#include <stdbool.h>
#include <stdint.h>

#if defined(__GNUC__)
#define MESH_MOTION_API __attribute__((visibility("default")))
#else
#define MESH_MOTION_API
#endif

#ifdef __cplusplus
extern "C" {
#endif

#define MESH_MOTION_KERNELS_VERSION "1.0.0"

/* What a call returns, numbered as in mesh_motion.h. */
enum {
    MESH_MOTION_OK = 0,
    MESH_MOTION_INVALID_ARGUMENT = 3,
    MESH_MOTION_OUT_OF_MEMORY = 8,
    MESH_MOTION_INTERNAL = 13
};

/* What becomes of results: they are written, or added to what is there. */
enum { MESH_MOTION_WRITE = 0, MESH_MOTION_ADD = 1 };

/* --- errors and threads ------------------------------------------------------------------------------------------- */

/* What was expected by the last call of this thread that failed; "" if none has. Valid until the next one fails. */
MESH_MOTION_API const char *mesh_motion_kernels_error(void);

/* Threads that this process may use: MESH_MOTION_THREADS from the environment, or the cores it may run on (those that
 * an MPI rank is bound to).
 */
MESH_MOTION_API int mesh_motion_available_threads(void);
/* Threads that calls of the calling thread use: all that are available until set, 1 to those available. */
MESH_MOTION_API int mesh_motion_get_threads(void);
MESH_MOTION_API int mesh_motion_set_threads(int threads);

/* --- interpolants ------------------------------------------------------------------------------------------------- */

/* s(x) = sum_j w_j phi(|x - x_j| / R) + p(x), for k components. */
typedef struct mesh_motion_interpolant mesh_motion_interpolant;

/* Basis functions phi: wendland-c0, wendland-c2, wendland-c4, wendland-c6, ctps-c0, ctps-c1, ctps-c2a, ctps-c2b
 * (compact: zero beyond R), tps, mqb, imqb, qb, iqb, gauss. support_radius: R > 0, a length; of tps it scales the
 * weights. dimension d: 1, 2 or 3. control_points (centres, d), weights (centres, components), both finite.
 */
MESH_MOTION_API int mesh_motion_interpolant_create(const char *basis, double support_radius, int64_t dimension,
                                                   int64_t centres, const double *control_points, int64_t components,
                                                   const double *weights, mesh_motion_interpolant **interpolant);
/* The same bits of a part of the control points, at points in a part of space: all control points of the cells of a grid
 * that hold these points, and of the cells next to those, in their order among all. The grid is that of all control
 * points: origin (3) is their lower corner, extent how far they reach from it along the longest axis; shape (3) cells
 * along each axis, which are 1/inverse_side wide, at least R; a single cell has inverse_side 0.
 */
MESH_MOTION_API int mesh_motion_interpolant_create_on_grid(const char *basis, double support_radius, int64_t dimension,
                                                           const double *origin, double inverse_side, double extent,
                                                           const int64_t *shape, int64_t centres,
                                                           const double *control_points, int64_t components,
                                                           const double *weights,
                                                           mesh_motion_interpolant **interpolant);
/* NULL is admitted. */
MESH_MOTION_API void mesh_motion_interpolant_free(mesh_motion_interpolant *interpolant);
/* p(x) = b_0 + sum_m b_m (x_m - centre_m) / scale. centre (d), scale not 0, coefficients b (d + 1, components). */
MESH_MOTION_API int mesh_motion_interpolant_set_polynomial(mesh_motion_interpolant *interpolant, const double *centre,
                                                           double scale, const double *coefficients);

/* values (n, components) at points (n, d). mode: MESH_MOTION_WRITE, or MESH_MOTION_ADD.
 *
 * A compact interpolant without a polynomial is added as a compact level of an interpolation in two scales: points out
 * of reach of all control points cost nothing, and a sum is formed in another order, so that its last bits may differ
 * from those that are written.
 */
MESH_MOTION_API int mesh_motion_interpolant_values(const mesh_motion_interpolant *interpolant, int64_t n,
                                                   const double *points, int mode, double *values);
/* gradients (n, components, d) at points (n, d): gradients[i, c, m] = d s_c / d x_m. Not of wendland-c0 and ctps-c0,
 * which have none at a control point.
 */
MESH_MOTION_API int mesh_motion_interpolant_gradients(const mesh_motion_interpolant *interpolant, int64_t n,
                                                      const double *points, int mode, double *gradients);

/* A compact interpolant without a polynomial at points that stay, of which those that are skipped (n), or none if that
 * is NULL, are not asked for: what does not depend on its weights is found once.
 */
typedef struct mesh_motion_near mesh_motion_near;
MESH_MOTION_API int mesh_motion_near_create(const mesh_motion_interpolant *interpolant, int64_t n, const double *points,
                                            const bool *skipped, mesh_motion_near **near);
/* NULL is admitted. */
MESH_MOTION_API void mesh_motion_near_free(mesh_motion_near *near);
/* values (n, components) += the interpolant with other weights (centres, components), as MESH_MOTION_ADD does. */
MESH_MOTION_API int mesh_motion_near_add(const mesh_motion_near *near, int64_t components, const double *weights,
                                         double *values);

/* --- nested splines ----------------------------------------------------------------------------------------------- */

/* A uniform cubic B-spline on nested boxes: the coarse field of an interpolation in two scales. */
typedef struct mesh_motion_spline mesh_motion_spline;

/* Boxes lie finest first; a point belongs to the first that holds it, or if none does to the last, at whose rim it is
 * then taken. origin (boxes, 3): lower corners; inverse_spacing (boxes); cells (boxes, 3), of which the first
 * `dimension` are not 0; start (boxes): first row of coefficients (rows, components) of each box, which stand on the
 * grid points -1 ... cells + 1 along each axis with cells, x slowest.
 */
MESH_MOTION_API int mesh_motion_spline_create(int64_t dimension, int64_t boxes, const double *origin,
                                              const double *inverse_spacing, const int64_t *cells,
                                              const int64_t *start, int64_t rows, int64_t components,
                                              const double *coefficients, mesh_motion_spline **spline);
/* NULL is admitted. */
MESH_MOTION_API void mesh_motion_spline_free(mesh_motion_spline *spline);
/* values (n, components) at points (n, d); mode as above. */
MESH_MOTION_API int mesh_motion_spline_values(const mesh_motion_spline *spline, int64_t n, const double *points,
                                              int mode, double *values);
/* The transpose: counts (rows, components) += what the coefficients count for weights (n, components) of the values. */
MESH_MOTION_API int mesh_motion_spline_counts(const mesh_motion_spline *spline, int64_t n, const double *points,
                                              int64_t components, const double *weights, double *counts);
/* gradients (n, components, d) at points (n, d). */
MESH_MOTION_API int mesh_motion_spline_gradients(const mesh_motion_spline *spline, int64_t n, const double *points,
                                                 int mode, double *gradients);

/* --- cells -------------------------------------------------------------------------------------------------------- */

/* The cells of a mesh, or of a part of it; all of one dimension d. */
typedef struct mesh_motion_cells mesh_motion_cells;

/* No cells; add_... appends count cells of one type with their nodes (count, nodes of the type). Cell numbers run
 * through the blocks as they are added; the server's order is that of the types in this list: line (d = 1); triangle,
 * quad (2); tetra, hexahedron, wedge, pyramid (3). Nodes in the order of VTK, but a wedge as in Gmsh: nodes 0, 1, 2
 * anticlockwise as seen from 3, 4, 5; their numbers are below 2^31 - 1 and kept as 32 bits.
 */
MESH_MOTION_API int mesh_motion_cells_create(mesh_motion_cells **cells);
MESH_MOTION_API int mesh_motion_cells_add(mesh_motion_cells *cells, const char *type, int64_t count,
                                          const int64_t *nodes);
/* NULL is admitted. */
MESH_MOTION_API void mesh_motion_cells_free(mesh_motion_cells *cells);

/* In all of these: points (n, d), of all nodes of the cells; results and what is known at rest (m), one a cell.
 *
 * sizes: sums of corner determinants, proportional to length, area or volume. At rest they are the reference sizes of
 * the calls below, where they must not be 0.
 */
MESH_MOTION_API int mesh_motion_cell_sizes(const mesh_motion_cells *cells, int64_t n, const double *points,
                                           double *sizes);
/* size: relative to the cell at rest, in [-1, 1]; skew: in [0, 1], 1 for the ideal cell; inverted: whether a corner's
 * determinant is not positive. Size and skew of a cell with a position that is not finite are -infinity. At rest the
 * skews are the skews at rest of the calls below.
 */
MESH_MOTION_API int mesh_motion_cell_quality(const mesh_motion_cells *cells, int64_t n, const double *points,
                                             const double *reference_sizes, double *size, double *skew,
                                             bool *inverted);

/* Percentiles are the values of the ranks p (m - 1) / 100, rounded down, in ascending order. */
typedef struct {
    double minimum, mean, p1, p5, p50;
} mesh_motion_distribution;

typedef struct {
    mesh_motion_distribution size, skew, size_skew, metric;
    int64_t inverted; /* number of cells */
} mesh_motion_quality;

/* The worst cells by a metric: size, skew, size-skew, size-skew-root, size-skew-product, relative-size-skew. The last
 * one needs skews_at_rest and points_at_rest (n, d); else they may be NULL. numbers and values (count): the lowest values, ascending, and their
 * cells, of equal values the lower ones; behind the last cell -1 and infinity. inverted (1): number of cells.
 *
 * Of cells on several MPI ranks the worst are among the worst of each.
 */
MESH_MOTION_API int mesh_motion_lowest_cells(const mesh_motion_cells *cells, int64_t n, const double *points,
                                             const double *reference_sizes, const double *skews_at_rest,
                                             const double *points_at_rest, const char *metric, int64_t count, int64_t *numbers, double *values,
                                             int64_t *inverted);
/* The same with the distributions, of at least one cell: three times the time of tetrahedra, 1.2 times that of
 * hexahedra.
 */
MESH_MOTION_API int mesh_motion_judge_cells(const mesh_motion_cells *cells, int64_t n, const double *points,
                                            const double *reference_sizes, const double *skews_at_rest,
                                            const double *points_at_rest, const char *metric, int64_t count, int64_t *numbers, double *values,
                                            mesh_motion_quality *quality);

/* boundary (n): whether a node is on a facet that one cell alone has. */
MESH_MOTION_API int mesh_motion_boundary_nodes(const mesh_motion_cells *cells, int64_t n, bool *boundary);

/* These facets, in the order of their cells: a node in 1D, an edge in 2D, a triangle or a quad in 3D. */
typedef struct {
    int64_t count;
    const int64_t *nodes; /* (count, 4): as seen from outside the cell anticlockwise, filled up with -1 */
} mesh_motion_facets;
MESH_MOTION_API int mesh_motion_facets_create(const mesh_motion_cells *cells, const mesh_motion_facets **facets);
/* NULL is admitted. */
MESH_MOTION_API void mesh_motion_facets_free(const mesh_motion_facets *facets);

/* near (n): whether points (n, d) are within a distance of facets (count, d, d), segments in the plane and triangles in
 * space. */
MESH_MOTION_API int mesh_motion_near_facets(int64_t d, int64_t n, const double *points, int64_t count,
                                            const double *facets, double distance, bool *near);

/* --- the cells of a rank, judged together with those of others ---------------------------------------------------- */

#define MESH_MOTION_BINS 2048
#define MESH_MOTION_WORST 10

/* The cells of one rank, judged again and again in one pass each. The sum of the ranks' results is exact: section 23 of
 * the protocol says how. Of each value four bytes are kept.
 */
typedef struct mesh_motion_tally mesh_motion_tally;

typedef struct {
    int64_t cells, inverted;
    int64_t metrics; /* 3, or 4 where the metric is none of them: size, skew, size-skew, metric */
    const char *names[4];
    double sums[4], minima[4];
    int64_t worst_cells; /* rows of the next */
    /* type by its place in the list above, number among those of the type, metric, size, skew, size-skew, centre */
    double worst[MESH_MOTION_WORST][9];
} mesh_motion_part;

/* Cells with their nodes at rest at points (n, d), and the metric that ranks them. The cells must stay while the tally
 * does. Refuses cells that are inverted or flat at rest.
 */
MESH_MOTION_API int mesh_motion_tally_create(const mesh_motion_cells *cells, int64_t n, const double *points,
                                             const char *metric, mesh_motion_tally **tally);
/* NULL is admitted. */
MESH_MOTION_API void mesh_motion_tally_free(mesh_motion_tally *tally);
/* Judges the cells with their nodes at points (n, d), which must stay for the next call. */
MESH_MOTION_API int mesh_motion_tally_judge(mesh_motion_tally *tally, int64_t n, const double *points,
                                            mesh_motion_part *part);
/* What values of a metric are in the bin at the end of a way (divisions, 3): low, scale, bin. counts
 * (MESH_MOTION_BINS): in each of its parts. different: how many different values, of which the first `most` are in
 * values and how often each occurs in repeated (most); -1: the server does not need them.
 */
MESH_MOTION_API int mesh_motion_tally_bin(const mesh_motion_tally *tally, const char *metric, int64_t divisions,
                                          const double *way, int64_t *counts, int64_t most, double *values,
                                          int64_t *repeated, int64_t *different);

/* The bad cells of a rank and their neighbours, as CORRECT of the protocol sends them: section 23. */
typedef struct {
    int64_t cells[7];     /* how many are sent, by type in the list above … */
    const char *names[7]; /* … which are these */
    int64_t nodes, corners;
    const int64_t *indices, *whole; /* (nodes): of their nodes, and 1 where all cells at it are sent, else 0 */
    const int64_t *rows;            /* (corners): of each cell, type after type, the places of its nodes in indices */
    double least_skew, least_size;  /* of all other cells, relative to them at rest; 1 without any */
} mesh_motion_region;

/* Cells of the tally whose metric, with nodes at points (n, d), is less than `below`, or that are inverted; and all
 * within so many rings of cells about these, or about further nodes (around). The metric is that of the tally, or
 * "corner-shape-size" where that is "relative-size-skew".
 */
MESH_MOTION_API int mesh_motion_region_create(const mesh_motion_tally *tally, int64_t n, const double *points,
                                              const char *metric, double below, int64_t rings, int64_t around, const int64_t *nodes,
                                              const mesh_motion_region **region);
/* The cells about nodes that are marked (n), but for those that are taken (one a cell), which these are afterwards; in
 * `whole` is 1 where all cells of a node are taken. */
MESH_MOTION_API int mesh_motion_cells_about_create(const mesh_motion_cells *cells, int64_t n, const bool *marked,
                                                   bool *taken, const mesh_motion_region **region);
/* NULL is admitted. */
MESH_MOTION_API void mesh_motion_region_free(const mesh_motion_region *region);

#ifdef __cplusplus
}
#endif

#endif
