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

/* Return values of the calls, numbered as in mesh_motion.h. */
enum {
    MESH_MOTION_OK = 0,
    MESH_MOTION_INVALID_ARGUMENT = 3,
    MESH_MOTION_OUT_OF_MEMORY = 8,
    MESH_MOTION_INTERNAL = 13
};

/* Whether results are written to an array, or added to its values. */
enum { MESH_MOTION_WRITE = 0, MESH_MOTION_ADD = 1 };

/* --- errors and threads ------------------------------------------------------------------------------------------- */

/* The error message of the last failed call of this thread; "" if none failed. Valid until the next call fails. */
MESH_MOTION_API const char *mesh_motion_kernels_error(void);

/* Threads that this process may use: MESH_MOTION_THREADS from the environment, or the number of cores it may run on (in
 * an MPI rank: those that the rank is bound to).
 */
MESH_MOTION_API int mesh_motion_available_threads(void);
/* Threads that the calls of the calling thread use, from 1 to the available ones; all of them until set. */
MESH_MOTION_API int mesh_motion_get_threads(void);
MESH_MOTION_API int mesh_motion_set_threads(int threads);

/* --- interpolants ------------------------------------------------------------------------------------------------- */

/* s(x) = sum_j w_j phi(|x - x_j| / R) + p(x), for k components. */
typedef struct mesh_motion_interpolant mesh_motion_interpolant;

/* Basis functions phi: wendland-c0, wendland-c2, wendland-c2-multiscale, wendland-c4, wendland-c6, ctps-c0, ctps-c1,
 * ctps-c2a, ctps-c2b (compact: zero beyond R), tps, mqb, imqb, qb, iqb, gauss. support_radius: R > 0, a length; of tps it scales the
 * weights. dimension d: 1, 2 or 3. control_points (centres, d), weights (centres, components), both finite.
 */
MESH_MOTION_API int mesh_motion_interpolant_create(const char *basis, double support_radius, int64_t dimension,
                                                   int64_t centres, const double *control_points, int64_t components,
                                                   const double *weights, mesh_motion_interpolant **interpolant);
/* An interpolant with some of the control points that gives the same bits as with all, at points in a part of space. It
 * needs all control points in the grid cells that contain these points and in the neighbouring cells, in their order
 * among all. The grid is that of all control points: origin (3) is their lower corner, extent their largest distance
 * from it along an axis; shape (3) is the number of cells along each axis, which are 1/inverse_side wide, at least R; a
 * single cell has inverse_side 0.
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
 * MESH_MOTION_ADD adds a compact interpolant without a polynomial as a compact level of an interpolation in two scales:
 * points beyond the reach of all control points cost nothing. The order of the sums differs, so the last bits may
 * differ from those of MESH_MOTION_WRITE.
 */
MESH_MOTION_API int mesh_motion_interpolant_values(const mesh_motion_interpolant *interpolant, int64_t n,
                                                   const double *points, int mode, double *values);
/* gradients (n, components, d) at points (n, d): gradients[i, c, m] = d s_c / d x_m. Not for wendland-c0 and ctps-c0,
 * which have no gradient at a control point.
 */
MESH_MOTION_API int mesh_motion_interpolant_gradients(const mesh_motion_interpolant *interpolant, int64_t n,
                                                      const double *points, int mode, double *gradients);

/* A compact interpolant without a polynomial at constant points: the parts that do not depend on the weights are
 * computed once. skipped (n) marks points without values; NULL: none.
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

/* The finest box comes first. A point belongs to the first box that contains it; if no box does, to the last box, where
 * it is moved to the rim. origin (boxes, 3): lower corners; inverse_spacing (boxes); cells (boxes, 3), of which the
 * first `dimension` are not 0; start (boxes): first row of coefficients (rows, components) of each box. Coefficients
 * belong to the grid points -1 ... cells + 1 along each axis with cells, x slowest.
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
/* The transpose: counts (rows, components) += the transposed matrix of spline_values times weights (n, components). */
MESH_MOTION_API int mesh_motion_spline_counts(const mesh_motion_spline *spline, int64_t n, const double *points,
                                              int64_t components, const double *weights, double *counts);
/* gradients (n, components, d) at points (n, d). */
MESH_MOTION_API int mesh_motion_spline_gradients(const mesh_motion_spline *spline, int64_t n, const double *points,
                                                 int mode, double *gradients);

/* --- cells -------------------------------------------------------------------------------------------------------- */

/* The cells of a mesh, or of a part of it; all of one dimension d. */
typedef struct mesh_motion_cells mesh_motion_cells;

/* Makes an empty set; add_... appends count cells of one type with their nodes (count, nodes of the type). Cells are
 * numbered in the order in which they are added; the server's order of types is: line (d = 1); triangle, quad (2);
 * tetra, hexahedron, wedge, pyramid (3). Nodes are in VTK's order, but those of a wedge in Gmsh's: nodes 0, 1, 2
 * anticlockwise as seen from 3, 4, 5. Node numbers are below 2^31 - 1 and stored in 32 bits.
 */
MESH_MOTION_API int mesh_motion_cells_create(mesh_motion_cells **cells);
MESH_MOTION_API int mesh_motion_cells_add(mesh_motion_cells *cells, const char *type, int64_t count,
                                          const int64_t *nodes);
/* NULL is admitted. */
MESH_MOTION_API void mesh_motion_cells_free(mesh_motion_cells *cells);

/* In all of these calls: points (n, d) of all nodes; results, and values at rest, (m): one for each cell.
 *
 * sizes: sums of corner determinants, proportional to length, area or volume. At rest they are the reference sizes of
 * the calls below, where they must not be 0.
 */
MESH_MOTION_API int mesh_motion_cell_sizes(const mesh_motion_cells *cells, int64_t n, const double *points,
                                           double *sizes);
/* size: relative to the cell at rest, in [-1, 1]; skew: in [0, 1], 1 for the ideal cell; inverted: whether a corner's
 * determinant is not positive. Size and skew are -infinity if the position of a node is not finite. The skews computed
 * at rest are skews_at_rest of the calls below.
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
 * one needs skews_at_rest and points_at_rest (n, d); otherwise they may be NULL. numbers and values (count): the cells
 * with the lowest values, and these values, ascending; of equal values the lower cell numbers; after the last cell -1
 * and infinity. inverted (1): number of inverted cells.
 *
 * The worst cells of several MPI ranks are among the worst cells of each rank.
 */
MESH_MOTION_API int mesh_motion_lowest_cells(const mesh_motion_cells *cells, int64_t n, const double *points,
                                             const double *reference_sizes, const double *skews_at_rest,
                                             const double *points_at_rest, const char *metric, int64_t count, int64_t *numbers, double *values,
                                             int64_t *inverted);
/* The same with the distributions; needs at least one cell. It takes three times as long for tetrahedra, 1.2 times for
 * hexahedra.
 */
MESH_MOTION_API int mesh_motion_judge_cells(const mesh_motion_cells *cells, int64_t n, const double *points,
                                            const double *reference_sizes, const double *skews_at_rest,
                                            const double *points_at_rest, const char *metric, int64_t count, int64_t *numbers, double *values,
                                            mesh_motion_quality *quality);

/* boundary (n): whether a node is on a facet that belongs to only one cell. */
MESH_MOTION_API int mesh_motion_boundary_nodes(const mesh_motion_cells *cells, int64_t n, bool *boundary);

/* The facets of the boundary, in the order of their cells: a node in 1D, an edge in 2D, a triangle or a quad in 3D. */
typedef struct {
    int64_t count;
    const int64_t *nodes; /* (count, 4): anticlockwise as seen from outside the cell, filled up with -1 */
} mesh_motion_facets;
MESH_MOTION_API int mesh_motion_facets_create(const mesh_motion_cells *cells, const mesh_motion_facets **facets);
/* NULL is admitted. */
MESH_MOTION_API void mesh_motion_facets_free(const mesh_motion_facets *facets);

/* near (n): whether points (n, d) are within a distance of facets (count, d, d): segments in 2D, triangles in 3D. */
MESH_MOTION_API int mesh_motion_near_facets(int64_t d, int64_t n, const double *points, int64_t count,
                                            const double *facets, double distance, bool *near);

/* --- the cells of a rank, judged together with those of others ---------------------------------------------------- */

#define MESH_MOTION_BINS 2048
#define MESH_MOTION_WORST 10

/* The cells of one rank, judged many times, each time in one pass. The sum over the ranks is exact: section 23 of the
 * protocol says how. Four bytes of each value are kept.
 */
typedef struct mesh_motion_tally mesh_motion_tally;

typedef struct {
    int64_t cells, inverted;
    int64_t metrics; /* size, skew, size-skew, and the metric if it is another one: 3 or 4 */
    const char *names[4];
    double sums[4], minima[4];
    int64_t worst_cells; /* number of rows of worst */
    /* type (its place in the list of types), number among its cells, metric, size, skew, size-skew, centre */
    double worst[MESH_MOTION_WORST][9];
} mesh_motion_part;

/* Takes cells with their nodes at rest at points (n, d), and the metric that ranks them. The cells must exist as long
 * as the tally. Refuses cells that are inverted or flat at rest.
 */
MESH_MOTION_API int mesh_motion_tally_create(const mesh_motion_cells *cells, int64_t n, const double *points,
                                             const char *metric, mesh_motion_tally **tally);
/* NULL is admitted. */
MESH_MOTION_API void mesh_motion_tally_free(mesh_motion_tally *tally);
/* Judges the cells with their nodes at points (n, d), an array that must stay valid for the next call. */
MESH_MOTION_API int mesh_motion_tally_judge(mesh_motion_tally *tally, int64_t n, const double *points,
                                            mesh_motion_part *part);
/* The values of a metric in the bin at the end of a way (divisions, 3): low, scale, bin. counts (MESH_MOTION_BINS): the
 * number of values in each part of the bin. different: the number of different values; the first `most` of them are in
 * values, and their numbers of occurrences in repeated (most). different = -1: the server does not need the values.
 */
MESH_MOTION_API int mesh_motion_tally_bin(const mesh_motion_tally *tally, const char *metric, int64_t divisions,
                                          const double *way, int64_t *counts, int64_t most, double *values,
                                          int64_t *repeated, int64_t *different);

/* The bad cells of a rank and their neighbours, as CORRECT of the protocol sends them: section 23. */
typedef struct {
    int64_t cells[7];     /* number of cells of each type that are sent */
    const char *names[7]; /* the names of these types */
    int64_t nodes, corners;
    const int64_t *indices, *whole; /* (nodes): their nodes; 1 if all cells at a node are sent, else 0 */
    const int64_t *rows;            /* (corners): the places of each cell's nodes in indices, type after type */
    double least_skew, least_size;  /* of all other cells, relative to rest; 1 if there are none */
} mesh_motion_region;

/* The region has the bad cells of the tally: those that are inverted, or whose metric with nodes at points (n, d) is
 * less than `below`. It also has all cells in the given number of rings around these cells and around the nodes
 * (around). The metric is that of the
 * tally; "corner-shape-size" is possible if that is "relative-size-skew".
 */
MESH_MOTION_API int mesh_motion_region_create(const mesh_motion_tally *tally, int64_t n, const double *points,
                                              const char *metric, double below, int64_t rings, int64_t around, const int64_t *nodes,
                                              const mesh_motion_region **region);
/* The cells at marked (n) nodes, except those that are already taken (one for each cell); afterwards these cells are
 * taken too. `whole` is 1 for a node whose cells are all taken. */
MESH_MOTION_API int mesh_motion_cells_about_create(const mesh_motion_cells *cells, int64_t n, const bool *marked,
                                                   bool *taken, const mesh_motion_region **region);
/* NULL is admitted. */
MESH_MOTION_API void mesh_motion_region_free(const mesh_motion_region *region);

#ifdef __cplusplus
}
#endif

#endif
