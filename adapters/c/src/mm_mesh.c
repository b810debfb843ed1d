/* The mesh: the caller's arrays and their check. See mesh_motion.h. */
#include "mm_mesh.h"

#ifdef MM_EVALUATION
#include "mm_volume.h"
#endif

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* More than any machine holds: a count above it was negative. */
#define MOST_ROWS ((size_t)1 << 48)

/* --- what an earlier mesh and trial leave ------------------------------------------------------------------------- */

void mmi_free_freed(freed *old)
{
    free(old->nodes);
    free(old->displacement);
    free(old->sent);
    *old = (freed){0};
}

void mmi_forget_accepted(mm_session *session)
{
    while (session->accepted_count) {
        mmi_free_request(&session->accepted[--session->accepted_count]);
    }
    mmi_free_freed(&session->trial_freed);
}

void mmi_forget_volume(mm_session *session)
{
    mmi_forget_accepted(session);
    mmi_free_freed(&session->committed_freed);
#ifdef MM_EVALUATION
    mmv_free(session->volume);
#endif
    session->volume = NULL;
}

/* --- what the caller gives ---------------------------------------------------------------------------------------- */

void mmi_free_blocks(mm_session *session)
{
    for (size_t i = 0; i < session->block_count; ++i) {
        free(session->blocks[i].owned);
    }
    session->block_count = 0;
}

mm_result mmi_add_block(mm_session *session, const block *added)
{
    if (added->rows > MOST_ROWS) {
        mmi_fail(session->context, "INVALID_ARGUMENT", "a negative number is one of these",
                 "%s: the number of rows is %zu, expected at most %zu", added->item, added->rows, MOST_ROWS);
        return session->context->error;
    }
    block *blocks =
        mmi_one_more(session->context, session->blocks, session->block_count, &session->block_capacity, sizeof *blocks);
    if (blocks) {
        session->blocks = blocks;
        blocks[session->block_count++] = *added;
    }
    return session->context->error;
}

mm_result mm_points(mm_session *session, int dimension, size_t nodes, const double *points)
{
    BEGIN_SESSION(session);
    if (dimension < 1 || dimension > 3 || (nodes && !points)) {
        return mmi_invalid(session->context, "the first argument after the session is the dimension",
                           "points must have 1, 2 or 3 coordinates%s", "");
    }
    block made = mmi_make_block("nodes", points, nodes, (size_t)dimension, 8);
    made.is_float = 1;
    if (session->volume) { /* of an earlier mesh */
        mmi_forget_volume(session);
        mmi_free_blocks(session);
    }
    session->dimension = dimension;
    session->nodes = nodes;
    /* a second call replaces the points, which must come first */
    if (session->block_count && strcmp(session->blocks[0].item, "nodes") == 0) {
        session->blocks[0] = made;
        return MM_OK;
    }
    if (session->block_count) {
        return mmi_invalid(session->context, "call mm_points first",
                           "mm_points must be called before cells, patches and global ids%s", "");
    }
    return mmi_add_block(session, &made);
}

size_t mmi_corners_of(const char *type)
{
    static const struct {
        const char *type;
        size_t nodes;
    } TYPES[] = {{"line", 2},    {"triangle", 3}, {"quad", 4},      {"tetra", 4},
                 {"pyramid", 5}, {"wedge", 6},    {"hexahedron", 8}};
    for (size_t i = 0; type && i < sizeof TYPES / sizeof *TYPES; ++i) {
        if (strcmp(type, TYPES[i].type) == 0) {
            return TYPES[i].nodes;
        }
    }
    return 0;
}

static mm_result add_cells(mm_session *session, const char *type, size_t cells, const void *nodes, size_t width)
{
    size_t corners = mmi_corners_of(type);
    BEGIN_SESSION(session);
    if (corners && (nodes || cells == 0)) {
        block made = mmi_make_block("cells", nodes, cells, corners, width);
        snprintf(made.name, sizeof made.name, "%s", type);
        return mmi_add_block(session, &made);
    }
    return mmi_invalid(session->context, "divide other cells, or give their corners alone",
                       "cell types are line, triangle, quad, tetra, pyramid, wedge, hexahedron, with nodes; got '%s'",
                       type ? type : "");
}

mm_result mm_cells(mm_session *session, const char *type, size_t cells, const int64_t *nodes)
{
    return add_cells(session, type, cells, nodes, 8);
}

mm_result mm_cells32(mm_session *session, const char *type, size_t cells, const int32_t *nodes)
{
    return add_cells(session, type, cells, nodes, 4);
}

mm_result mm_patch(mm_session *session, const char *name, const char *role, size_t nodes, const int64_t *indices)
{
    static const char *const ROLES[] = {"moving", "fixed", "slip", "symmetry", "periodic"};
    BEGIN_SESSION(session);
    if (!name || !*name || strlen(name) >= NAME_BYTES || (nodes && !indices)) {
        return mmi_invalid(session->context, "give a name that is not empty, and the array of nodes",
                           "a patch must have a name of at most 256 bytes, and nodes; got '%s'", name ? name : "");
    }
    for (size_t i = 0; role && i < sizeof ROLES / sizeof *ROLES; ++i) {
        if (strcmp(role, ROLES[i]) == 0) {
            block made = mmi_make_block("patch", indices, nodes, 1, 8);
            snprintf(made.name, sizeof made.name, "%s", name);
            snprintf(made.role, sizeof made.role, "%s", role);
            return mmi_add_block(session, &made);
        }
    }
    return mmi_invalid(session->context, "nodes that slide along their wall have the role slip",
                       "a patch's role must be one of moving, fixed, slip, symmetry, periodic; got '%s'",
                       role ? role : "");
}

mm_result mm_global_ids(mm_session *session, const int64_t *ids)
{
    BEGIN_SESSION(session);
    if (!session->dimension || (session->nodes && !ids)) {
        return mmi_invalid(session->context, "call mm_points first, and give an array",
                           "global ids are one for each node, and mm_points comes before them%s", "");
    }
    block made = mmi_make_block("global_ids", ids, session->nodes, 1, 8);
    return mmi_add_block(session, &made);
}

/* --- check -------------------------------------------------------------------------------------------------------- */

size_t mmi_mesh_bytes(const mm_session *session)
{
    size_t bytes = 0;
    for (size_t i = 0; i < session->block_count; ++i) {
        bytes += mmi_array_bytes(&session->blocks[i]);
    }
    return bytes;
}

outcome mmi_check_rows(mm_context *context, const block *rows, size_t nodes, const char *what)
{
    size_t count = rows->rows * rows->columns;
    for (size_t i = 0; i < count; ++i) {
        int64_t index = 0;
        if (rows->is_float) {
            double value = ((const double *)rows->data)[i];
            if (!isfinite(value)) {
                return mmi_fail(context, "INVALID_ARGUMENT.NONFINITE", "look at the solver that sent it first",
                                "%s must be finite, got %g in row %zu", what, value, i / rows->columns);
            }
        } else {
            index = rows->width == 8 ? ((const int64_t *)rows->data)[i] : ((const int32_t *)rows->data)[i];
        }
        if (index < 0 || (uint64_t)index >= nodes) {
            return mmi_fail(context, "INVALID_ARGUMENT", "give numbers of nodes of this mesh",
                            "%s must name nodes below %zu, got %" PRId64 " in row %zu", what, nodes, index,
                            i / rows->columns);
        }
    }
    return DONE;
}

outcome mmi_check_mesh(mm_session *session)
{
    int has_ids = 0;
    for (size_t i = 0; i < session->block_count; ++i) {
        const block *part = &session->blocks[i];
        int is_ids = strcmp(part->item, "global_ids") == 0;
        char what[NAME_BYTES + 32];
        has_ids = has_ids || is_ids;
        snprintf(what, sizeof what, "%s %s", part->item, part->name);
        if (!is_ids && mmi_check_rows(session->context, part, session->nodes, what) != DONE) {
            return FAILED;
        }
    }
    if (session->partitions > 1 && !has_ids) {
        return mmi_fail(session->context, "INVALID_ARGUMENT.PARTITION", "mm_global_ids",
                        "with several partitions a mesh must have global ids");
    }
    return DONE;
}

outcome mmi_check_shape(mm_session *session, size_t first, size_t second)
{
    return first != MMI_OTHER_SHAPE && second != MMI_OTHER_SHAPE
               ? DONE
               : mmi_fail(session->context, "INVALID_ARGUMENT.SHAPE",
                          "arrays are (dimension, nodes), and of several vectors (dimension, vectors, nodes)",
                          "the first dimension of each array must be %d, and the number of vectors one for all",
                          session->dimension);
}
