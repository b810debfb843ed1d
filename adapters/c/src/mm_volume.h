/* The nodes and cells of a session whose client evaluates the field (SPEC.md, section 23), without sockets. The
 * server's compiled kernels, mesh_motion_kernels.h, do the computations, so the bits are those of the server.
 *
 * Calls return 0, or the number of an error, which mesh_motion_kernels_error() explains.
 */
#ifndef MM_VOLUME_H
#define MM_VOLUME_H

#include <mesh_motion_kernels.h>

#include <stddef.h>

typedef struct mmv_volume mmv_volume;

/* Copies the points (nodes, dimension); NULL without memory. */
mmv_volume *mmv_new(int dimension, size_t nodes, const double *points);
void mmv_free(mmv_volume *volume);
/* Copies the cells; node numbers have 4 or 8 bytes. */
int mmv_add_cells(mmv_volume *volume, const char *type, size_t cells, size_t corners, const void *nodes, size_t width);
/* Copies the nodes' numbers in the whole mesh; without a call they are the numbers here. */
int mmv_set_ids(mmv_volume *volume, const int64_t *ids);
void mmv_add_patch(mmv_volume *volume, size_t nodes, const int64_t *indices);
/* Called after the last cells and patches: finds the nodes that the server must know. */
int mmv_finish(mmv_volume *volume);
/* The nodes of mmv_finish, ascending, then those of mmv_extend and mmv_near in the order of the calls. */
const int64_t *mmv_uploaded(const mmv_volume *volume, size_t *count);
/* Row of a node among the nodes of mmv_finish. */
int64_t mmv_row_of(const mmv_volume *volume, int64_t node);
bool mmv_is_uploaded(const mmv_volume *volume, int64_t node);
/* The facets of the boundary with `corners` corners: their number, and their corners as rows of the uploaded nodes. */
size_t mmv_count_facets(const mmv_volume *volume, size_t corners);
void mmv_copy_facets(const mmv_volume *volume, size_t corners, int64_t *rows);
/* Adds nodes that the server knows too. */
int mmv_extend(mmv_volume *volume, size_t count, const int64_t *nodes);
/* The cells of the nodes within a distance (reach) of a wall's facets (facets, dimension, dimension), except cells that
 * were found before. `rows` are the corners of each cell as rows of the uploaded nodes; the call adds nodes to these.
 * The caller frees the result.
 */
int mmv_near(mmv_volume *volume, size_t facets, const double *wall, double reach, const mesh_motion_region **found,
             int64_t **rows);
const double *mmv_points(const mmv_volume *volume);
/* The first node that is in no cell; -1 if every node is in a cell. */
int64_t mmv_without_cell(const mmv_volume *volume);

/* A sum over centres, as in MOVED's `sums`. */
typedef struct {
    char basis[32];
    double radius;
    int64_t centres;
    double origin[3], inverse_side, extent; /* the grid of all its centres */
    int64_t shape[3];
    int has_polynomial;
    double centre[3], scale;
} mmv_sum;

/* The field, or only its coefficients if the other parts are known. The volume owns the arrays from now on, also after
 * an error. */
typedef struct {
    mmv_sum *sums;
    double *centres, *boxes, *coefficients; /* (…, dimension), (…, 14), (…, dimension) */
    size_t sum_count, centre_count, box_count, coefficient_count;
} mmv_field;
int mmv_set_field(mmv_volume *volume, mmv_field field);
int mmv_knows_field(const mmv_volume *volume);
/* displacement (nodes, dimension) from the reference mesh: from the field, and from the `known` rows of the uploaded
 * nodes. */
int mmv_displacement(mmv_volume *volume, const double *known, double *displacement);
size_t mmv_coefficient_count(const mmv_volume *volume);
/* velocity (nodes, dimension): from the field with these coefficients (mmv_coefficient_count, dimension), and from the
 * `known` rows of the uploaded nodes.
 */
int mmv_velocity(mmv_volume *volume, double *coefficients, const double *known, double *velocity);
/* The transpose: counts (mmv_coefficient_count, dimension), weights of the field's coefficients from weights (nodes,
 * dimension) of its values at the nodes.
 */
int mmv_counts(const mmv_volume *volume, const double *weights, double *counts);
/* Computes the quality of the cells with the nodes displaced. */
int mmv_judge(mmv_volume *volume, const double *displacement, const char *metric, mesh_motion_part *part);
/* The bad cells after the motion by the field and the `known` displacement rows of the uploaded nodes, and the cells
 * around them or around further nodes with the numbers `ids` in the whole mesh, in ascending order. `positions` are of
 * all nodes, until the next call.
 */
int mmv_region(mmv_volume *volume, const double *known, const char *metric, double below, int64_t rings, size_t around,
               const int64_t *ids, const mesh_motion_region **region, const double **positions);
int64_t mmv_id_of(const mmv_volume *volume, int64_t node);
/* Local numbers of nodes with these numbers in the whole mesh; -1 for a node that is not here. */
int mmv_find(const mmv_volume *volume, size_t count, const int64_t *ids, int64_t *nodes);
/* mesh_motion_tally_bin of the last computed quality of the cells. */
const mesh_motion_tally *mmv_tally(const mmv_volume *volume);

#endif
