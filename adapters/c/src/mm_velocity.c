/* Times, velocities of time schemes and swept volumes (SPEC.md, section 25). See mesh_motion.h. */
#include "mm_mesh.h"
#include "mm_session.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

mm_result mm_set_time_levels(mm_session *session, double start, const char *scheme)
{
    BEGIN_UNOPENED(session);
    if (!isfinite(start)) {
        return mmi_invalid(session->context, "give the time of the first mesh, usually 0",
                           "the time of the mesh as uploaded must be finite%s", "");
    }
    if (!scheme || strlen(scheme) >= sizeof session->time_levels) {
        return mmi_invalid(session->context, "give bdf2 or bossak, or \"\" for none",
                           "there are no such time levels: '%s'", scheme ? scheme : "");
    }
    session->start = start;
    snprintf(session->time_levels, sizeof session->time_levels, "%s", scheme);
    return MM_OK;
}

mm_result mm_set_time(mm_session *session, double time)
{
    BEGIN_SESSION(session);
    if (!isfinite(time)) {
        return mmi_invalid(session->context, "give the solver's time at the end of the step",
                           "the time of a step must be finite%s", "");
    }
    session->time = time;
    session->has_time = 1;
    return MM_OK;
}

mm_result mm_set_velocity(mm_session *session, const char *scheme)
{
    BEGIN_SESSION(session);
    if (!scheme || strlen(scheme) >= sizeof session->scheme) {
        return mmi_invalid(session->context, "give tangent, bdf1, bdf2 or bossak, or \"\" for none",
                           "there is no such scheme of velocities: '%s'", scheme ? scheme : "");
    }
    snprintf(session->scheme, sizeof session->scheme, "%s", scheme);
    return MM_OK;
}

/* Replace the kept array by a copy of `count` numbers of `size` bytes each; it has room for at least one. */
static outcome keep(mm_session *session, void **kept, const void *given, size_t count, size_t size)
{
    void *copy = calloc(count + 1, size);
    if (!copy) {
        return mmi_no_memory(session->context);
    }
    if (count) {
        memcpy(copy, given, count * size);
    }
    free(*kept);
    *kept = copy;
    return DONE;
}

mm_result mm_set_boundary_velocity(mm_session *session, size_t moving, const double *velocity)
{
    BEGIN_SESSION(session);
    size_t columns = (size_t)session->dimension;
    if (mmi_check_joined(session) != DONE || mmi_check_shape(session, moving, 0) != DONE) {
        return session->context->error;
    }
    if (moving != session->moving_count || (moving && !velocity)) {
        mmi_fail(session->context, "INVALID_ARGUMENT.SHAPE", "mm_moving_nodes returns them",
                 "the boundary velocity must have %zu rows, got %zu", session->moving_count, velocity ? moving : 0);
        return session->context->error;
    }
    block rows = mmi_make_block("boundary_velocity", velocity, moving, columns, 8);
    rows.is_float = 1;
    if (mmi_check_rows(session->context, &rows, moving + 1, "the boundary velocity") == DONE) {
        keep(session, (void **)&session->boundary_velocity, velocity, moving * columns, sizeof *velocity);
    }
    return session->context->error;
}

mm_result mm_set_swept_faces(mm_session *session, size_t faces, size_t corners, const int64_t *nodes)
{
    BEGIN_SESSION(session);
    if (!nodes) {
        free(session->swept_faces);
        session->swept_faces = NULL;
        return MM_OK;
    }
    if (!corners || corners > MMI_MOST_COLUMNS || faces > SIZE_MAX / sizeof *nodes / corners - 1) {
        char got[64];
        snprintf(got, sizeof got, "%zu faces of %zu nodes", faces, corners);
        return mmi_invalid(session->context, "give two nodes a face in a plane, three or four in space",
                           "there must be some nodes in each swept face, got %s", got);
    }
    if (keep(session, (void **)&session->swept_faces, nodes, faces * corners, sizeof *nodes) == DONE) {
        session->face_count = faces;
        session->face_corners = corners;
    }
    return session->context->error;
}

mm_result mm_set_headroom_along(mm_session *session, const char *way)
{
    BEGIN_SESSION(session);
    if (!way || strlen(way) >= sizeof session->headroom_along) {
        return mmi_invalid(session->context, "give step, displacement or velocity",
                           "there is no such way of a headroom: '%s'", way ? way : "");
    }
    snprintf(session->headroom_along, sizeof session->headroom_along, "%s", way);
    return MM_OK;
}

void mmi_add_levels(request *open, const mm_session *session)
{
    if (session->start != 0.0) {
        mmi_add_number(open, "time", session->start);
    }
    if (session->time_levels[0]) {
        mmi_add_text(open, "time_levels", session->time_levels);
    }
}

/* Copy an optional array of a reply. */
static outcome take(mm_session *session, const answer *from, const char *name, double **to, size_t *rows)
{
    const mmi_array *array = mmi_find_array(&from->reply, name);
    *rows = 0;
    if (!array) {
        return DONE;
    }
    double *values = realloc(*to, (array->rows * array->columns + 1) * sizeof *values);
    if (!values) {
        return mmi_no_memory(session->context);
    }
    *to = values;
    *rows = array->rows;
    mmi_take_numbers(values, from, array);
    return DONE;
}

outcome mmi_take_velocity(mm_session *session, const answer *from, size_t nodes)
{
    const mmi_array *velocity = mmi_find_array(&from->reply, "velocity");
    if (velocity && (velocity->rows != nodes || velocity->columns != (size_t)session->dimension)) {
        return mmi_fail(session->context, "INTERNAL", "",
                        "the server's velocity must have shape (%zu, %d), got (%zu, %zu)", nodes,
                        session->dimension, velocity->rows, velocity->columns);
    }
    outcome how = take(session, from, "velocity", &session->velocity, &session->velocity_count);
    return how == DONE ? take(session, from, "swept", &session->swept, &session->swept_count) : how;
}

const double *mm_velocity(const mm_session *session, size_t *count)
{
    if (count) {
        *count = session ? session->velocity_count : 0;
    }
    return session && session->velocity_count ? session->velocity : NULL;
}

const double *mm_swept(const mm_session *session, size_t *count)
{
    if (count) {
        *count = session ? session->swept_count : 0;
    }
    return session && session->swept_count ? session->swept : NULL;
}
