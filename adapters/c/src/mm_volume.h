/* The nodes and cells of a session whose client evaluates the field (SPEC.md, section 23), without sockets. What it
 * computes are the compiled kernels of the server, mesh_motion_kernels.h: the bits are those of the server.
 *
 * Calls return 0, or the number of an error, which mesh_motion_kernels_error() explains.
 */
#ifndef MM_VOLUME_H
#define MM_VOLUME_H

#include <mesh_motion_kernels.h>

#include <stddef.h>

typedef struct mmv_volume mmv_volume;

/* Copies the points (nodes, dimension); NULL where there is no memory. */
mmv_volume *mmv_new(int dimension, size_t nodes, const double *points);
void mmv_free(mmv_volume *volume);
/* Copies what it is given; node numbers of 4 or 8 bytes. */
int mmv_add_cells(mmv_volume *volume, const char *type, size_t cells, size_t corners, const void *nodes, size_t width);
/* Copies the nodes' numbers in the whole mesh; without a call they are those here. */
int mmv_set_ids(mmv_volume *volume, const int64_t *ids);
void mmv_add_patch(mmv_volume *volume, size_t nodes, const int64_t *indices);
/* After the last cells and patches: finds the nodes that the server must know. */
int mmv_finish(mmv_volume *volume);
/* Those nodes, ascending, then those of mmv_extend and mmv_near in the order of the calls. */
const int64_t *mmv_uploaded(const mmv_volume *volume, size_t *count);
/* Which of the first ones a node is. */
int64_t mmv_row_of(const mmv_volume *volume, int64_t node);
bool mmv_is_uploaded(const mmv_volume *volume, int64_t node);
/* The facets of the boundary with so many corners, and their corners as rows of the uploaded nodes. */
size_t mmv_count_facets(const mmv_volume *volume, size_t corners);
void mmv_copy_facets(const mmv_volume *volume, size_t corners, int64_t *rows);
/* The server knows these nodes too. */
int mmv_extend(mmv_volume *volume, size_t count, const int64_t *nodes);
/* The cells about the nodes within a reach of a wall's facets (facets, dimension, dimension), but for those that were
 * so before, for the caller to free: `rows` are the corners of each as rows of the uploaded nodes, of which there are
 * more afterwards.
 */
int mmv_near(mmv_volume *volume, size_t facets, const double *wall, double reach, const mesh_motion_region **found,
             int64_t **rows);
const double *mmv_points(const mmv_volume *volume);
/* The first node that is in no cell; -1: there is none. */
int64_t mmv_without_cell(const mmv_volume *volume);

/* A sum over centres, as MOVED's `sums` describe it. */
typedef struct {
    char basis[32];
    double radius;
    int64_t centres;
    double origin[3], inverse_side, extent; /* the grid of all its centres */
    int64_t shape[3];
    int has_polynomial;
    double centre[3], scale;
} mmv_sum;

/* The field, or the coefficients alone of one whose other parts are known; the volume owns the arrays from now on, whatever is returned. */
typedef struct {
    mmv_sum *sums;
    double *centres, *boxes, *coefficients; /* (…, dimension), (…, 14), (…, dimension) */
    size_t sum_count, centre_count, box_count, coefficient_count;
} mmv_field;
int mmv_set_field(mmv_volume *volume, mmv_field field);
int mmv_knows_field(const mmv_volume *volume);
/* displacement (nodes, dimension) from the reference mesh: by the field, and `known` rows of the uploaded nodes. */
int mmv_displacement(mmv_volume *volume, const double *known, double *displacement);
size_t mmv_coefficient_count(const mmv_volume *volume);
/* velocity (nodes, dimension): by the field with these coefficients (mmv_coefficient_count, dimension), and `known`
 * rows of the uploaded nodes.
 */
int mmv_velocity(mmv_volume *volume, double *coefficients, const double *known, double *velocity);
/* The transpose: counts (mmv_coefficient_count, dimension), what weights (nodes, dimension) of the field's values at
 * the nodes count for its coefficients.
 */
int mmv_counts(const mmv_volume *volume, const double *weights, double *counts);
/* Judges the cells with the nodes displaced. */
int mmv_judge(mmv_volume *volume, const double *displacement, const char *metric, mesh_motion_part *part);
/* The bad cells after the motion by the field, and `known` displacement rows of the uploaded nodes, and those about
 * them, or about further nodes with these numbers in the whole mesh, in ascending order. `positions` are of all nodes,
 * until the next call.
 */
int mmv_region(mmv_volume *volume, const double *known, const char *metric, double below, int64_t rings, size_t around,
               const int64_t *ids, const mesh_motion_region **region, const double **positions);
int64_t mmv_id_of(const mmv_volume *volume, int64_t node);
/* Of nodes with these numbers in the whole mesh: which they are here, or -1. */
int mmv_find(const mmv_volume *volume, size_t count, const int64_t *ids, int64_t *nodes);
/* mesh_motion_tally_bin of the cells as they were judged last. */
const mesh_motion_tally *mmv_tally(const mmv_volume *volume);

#endif
