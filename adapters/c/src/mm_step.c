/* A time step: moves, commit or rollback, and the server's reports about the session. See mesh_motion.h. */
#include "mm_evaluation.h"
#include "mm_mesh.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static outcome check_built(mm_session *session)
{
    if (mmi_check_joined(session) != DONE) {
        return FAILED;
    }
    if (!session->dimension || !session->moving) {
        return mmi_fail(session->context, "FAILED_PRECONDITION.STATE", "mm_build first", "the session is not built");
    }
    return DONE;
}

static outcome check_frame(const mm_session *session, mm_frame frame)
{
    return frame == MM_SINCE_COMMITTED || frame == MM_SINCE_REFERENCE
               ? DONE
               : mmi_fail(session->context, "INVALID_ARGUMENT", "give one of these",
                          "expected MM_SINCE_COMMITTED or MM_SINCE_REFERENCE, got %d", (int)frame);
}

static outcome check_move(mm_session *session, mm_frame frame, size_t moving, const double *displacement, size_t nodes,
                          const double *to)
{
    mm_context *context = session->context;
    if (check_built(session) != DONE || check_frame(session, frame) != DONE
        || mmi_check_shape(session, moving, nodes) != DONE) {
        return FAILED;
    }
    if (moving != session->moving_count || (session->nodes && nodes != session->nodes)) {
        return mmi_fail(context, "INVALID_ARGUMENT.SHAPE", "mm_moving_nodes and mm_node_count return them",
                        "the displacement must have %zu rows and the answer %zu, got %zu and %zu",
                        session->moving_count, session->nodes, moving, nodes);
    }
    if ((moving && !displacement) || (nodes && !to)) {
        return mmi_fail(context, "INVALID_ARGUMENT", "give arrays of mm_moving_nodes and mm_node_count rows",
                        "the displacement and the answer must not be NULL");
    }
    block rows = mmi_make_block("displacement", displacement, moving, (size_t)session->dimension, 8);
    rows.is_float = 1;
    return mmi_check_rows(context, &rows, moving + 1, "the displacement");
}

/* Copy the rows for nodes of the partition, `vectors` in each, from a reply into the caller's array. */
static outcome take_rows(mm_session *session, const answer *from, const char *name, size_t nodes, size_t vectors,
                         double *to)
{
    const mmi_array *array = mmi_find_array(&from->reply, name);
    size_t columns = vectors * (size_t)session->dimension;
    if (array->rows != nodes || array->columns != columns) {
        return mmi_fail(session->context, "INTERNAL", "", "the server's %s must have shape (%zu, %zu), got (%zu, %zu)",
                        name, nodes, columns, array->rows, array->columns);
    }
    mmi_take_numbers(to, from, array);
    return DONE;
}

static outcome take_enrichment(mm_session *session, const answer *from)
{
    const mmi_array *array = mmi_find_array(&from->reply, "enrichment_points");
    if (array->rows && array->columns != (size_t)session->dimension) {
        return mmi_fail(session->context, "INTERNAL", "",
                        "the server's enrichment points must have %d coordinates, got %zu", session->dimension,
                        array->columns);
    }
    double *points = realloc(session->enrichment, (array->rows * array->columns + 1) * sizeof *points);
    if (!points) {
        return mmi_no_memory(session->context);
    }
    session->enrichment = points;
    session->enrichment_count = array->rows;
    mmi_take_numbers(points, from, array);
    return DONE;
}

mm_result mm_set_report(mm_session *session, const char *report)
{
    BEGIN_SESSION(session);
    if (!report || strlen(report) >= sizeof session->report) {
        return mmi_invalid(session->context, "give faces, headroom or swept, or \"\" for none",
                           "there is no such report: '%s'", report ? report : "");
    }
    snprintf(session->report, sizeof session->report, "%s", report);
    return MM_OK;
}

mm_result mm_set_compute_limit(mm_session *session, double seconds)
{
    BEGIN_SESSION(session);
    if (!(seconds >= 0 && seconds <= 1e9)) {
        return mmi_invalid(session->context, "give seconds; 0 is no limit",
                           "a limit of computing must be 0 to 1e9 s%s", "");
    }
    session->compute_limit_ms = (int64_t)ceil(1000 * seconds);
    return MM_OK;
}

mm_result mm_move(mm_session *session, mm_frame frame, size_t moving, const double *displacement, size_t nodes,
                  double *to)
{
    BEGIN_SESSION(session);
    if (check_move(session, frame, moving, displacement, nodes, to) != DONE) {
        return session->context->error;
    }
    answer moved = {0};
    request move = mmi_move_request(session, frame, displacement);
    if (session->compute_limit_ms) {
        mmi_add_integer(&move, "compute_limit_ms", session->compute_limit_ms);
    }
    if (mmi_knows_field(session)) {
        mmi_add_flag(&move, "field_known", 1);
    }
    outcome how = mmi_deliver(session, &move, session->context->compute_timeout, &moved);
    if (how == DONE && !session->evaluates) {
        how = take_rows(session, &moved, "displacement", nodes, 1, to);
    }
    if (how == DONE) {
        how = take_enrichment(session, &moved);
    }
    if (how == DONE) {
        how = mmi_take_velocity(session, &moved, nodes);
    }
    if (how == DONE) {
        session->iteration = mmi_integer_field(&moved, "iteration");
        session->trial_frame = frame;
        session->has_trial = 1;
        mmi_forget_accepted(session);
        if (moving) { /* a rank without moving nodes may have no array */
            memcpy(session->trial, displacement, moving * (size_t)session->dimension * sizeof *displacement);
        }
        snprintf(session->state, sizeof session->state, "TRIAL");
        if (session->evaluates) {
            mmi_take_trial(session, &moved, to);
        } else {
            mmi_keep_report(&session->moved, &moved);
        }
    }
    mmi_free_answer(&moved);
    return session->context->error;
}

static outcome check_vectors(mm_session *session, size_t vectors, size_t moving, size_t nodes, const void *given,
                             const void *to)
{
    mm_context *context = session->context;
    if (check_built(session) != DONE || mmi_check_shape(session, moving, nodes) != DONE) {
        return FAILED;
    }
    if (moving != session->moving_count || nodes != session->nodes) {
        return mmi_fail(context, "INVALID_ARGUMENT.SHAPE", "mm_moving_nodes and mm_node_count return them",
                        "there are %zu moving nodes of %zu, got %zu of %zu", session->moving_count, session->nodes,
                        moving, nodes);
    }
    if (!vectors || vectors > MMI_MOST_COLUMNS / (size_t)session->dimension || !given || !to) {
        return mmi_fail(context, "INVALID_ARGUMENT", "give both arrays, and more vectors in further calls",
                        "vectors and answer must not be NULL, and there must be 1 to %zu of them, got %zu",
                        MMI_MOST_COLUMNS / (size_t)session->dimension, vectors);
    }
    return DONE;
}

/* True if the server was restarted since the committed state was corrected. */
static int misses_region(const mm_session *session)
{
    char missing[16];
    mm_report_text(&session->context->problem.details, "missing", missing, sizeof missing);
    return session->evaluates && !session->has_trial && strcmp(missing, "region") == 0;
}

/* Send (nodes, vectors * dimension) numbers, and receive (rows, vectors * dimension). Nothing changes. */
static void differentiate(mm_session *session, const char *type, const char *name, size_t nodes, const double *given,
                          size_t rows, size_t vectors, double *to)
{
    int is_tangent = strcmp(type, "TANGENT") == 0;
    block array = mmi_make_block(name, given, nodes, vectors * (size_t)session->dimension, 8);
    outcome how = DONE;
    array.is_float = 1;
    if (session->evaluates) {
        how = mmi_check_rows(session->context, &array, nodes + 1, name);
    }
    for (int is_first = 1, is_over = 0; how == DONE && !is_over; is_first = 0) {
        answer found = {0};
        if (session->evaluates && mmi_know_correction(session) != DONE) {
            return;
        }
        request ask = mmi_session_request(session, type, is_tangent ? "TANGENT_FOUND" : "COTANGENT_FOUND");
        mmi_add_text(&ask, "what", session->has_trial ? "trial" : "committed");
        ask.arrays[0] = array;
        if (session->evaluates && !is_tangent) {
            how = mmi_add_weights(session, vectors, given, &ask);
        }
        how = how == DONE ? mmi_deliver(session, &ask, session->context->compute_timeout, &found) : how;
        is_over = how == DONE || !is_first || !misses_region(session);
        if (!is_over) { /* all partitions get this answer */
            mm_clear_error(session->context);
            mmi_forget_correction(session);
            how = DONE;
        } else if (how == DONE && session->evaluates && is_tangent) {
            mmi_take_tangent(session, vectors, &found, to);
        } else if (how == DONE) {
            take_rows(session, &found, is_tangent ? "velocity" : "weights", rows, vectors, to);
        }
        mmi_free_request(&ask);
        mmi_free_answer(&found);
    }
}

mm_result mm_tangent(mm_session *session, size_t vectors, size_t moving, const double *velocity, size_t nodes,
                     double *to)
{
    BEGIN_SESSION(session);
    if (check_vectors(session, vectors, moving, nodes, velocity, to) == DONE) {
        differentiate(session, "TANGENT", "velocity", moving, velocity, nodes, vectors, to);
    }
    return session->context->error;
}

mm_result mm_cotangent(mm_session *session, size_t vectors, size_t nodes, const double *weights, size_t moving,
                       double *to)
{
    BEGIN_SESSION(session);
    if (check_vectors(session, vectors, moving, nodes, weights, to) == DONE) {
        differentiate(session, "COTANGENT", "weights", nodes, weights, moving, vectors, to);
    }
    return session->context->error;
}

mm_result mm_set_final_step(mm_session *session, int64_t step)
{
    BEGIN_SESSION(session);
    if (step < 0) {
        char got[24];
        snprintf(got, sizeof got, "%lld", (long long)step);
        return mmi_invalid(session->context, "give the number of the last step, or 0",
                           "the final step must be 0 (unknown) or more, got %s", got);
    }
    session->final_step = step;
    return MM_OK;
}

static void end_step(mm_session *session)
{
    session->iteration = 0;
    session->has_trial = 0;
    snprintf(session->state, sizeof session->state, "READY");
}

mm_result mm_commit(mm_session *session)
{
    BEGIN_SESSION(session);
    if (mmi_check_joined(session) != DONE) {
        return session->context->error;
    }
    answer committed = {0};
    request commit = mmi_session_request(session, "COMMIT", "COMMITTED");
    mmi_add_integer(&commit, "step", session->step + 1);
    if (session->has_time) {
        mmi_add_number(&commit, "time", session->time);
    }
    if (session->final_step) {
        mmi_add_integer(&commit, "final_step", session->final_step);
    }
    if (mmi_deliver(session, &commit, session->context->compute_timeout, &committed) == DONE) {
        const mm_report *report = &committed.reply.report;
        session->step = mmi_integer_field(&committed, "step");
        session->durable_step = mmi_integer_field(&committed, "durable_step");
        memcpy(session->digest, report->bytes + report->nodes[mmi_field(&committed, "digest")].u.offset,
               sizeof session->digest);
        end_step(session);
        mmi_keep_freed(session);
        mmi_keep_report(&session->committed, &committed);
    }
    mmi_free_answer(&committed);
    return session->context->error;
}

mm_result mm_rollback(mm_session *session)
{
    BEGIN_SESSION(session);
    if (mmi_check_joined(session) != DONE) {
        return session->context->error;
    }
    answer rolled_back = {0};
    request rollback = mmi_session_request(session, "ROLLBACK", "ROLLED_BACK");
    mmi_add_integer(&rollback, "step", session->step + 1);
    if (mmi_deliver(session, &rollback, session->context->compute_timeout, &rolled_back) == DONE) {
        end_step(session);
    }
    mmi_free_answer(&rolled_back);
    return session->context->error;
}

mm_result mm_fetch(mm_session *session, mm_frame which, size_t nodes, double *points)
{
    BEGIN_SESSION(session);
    if (mmi_check_joined(session) != DONE || check_frame(session, which) != DONE
        || mmi_check_shape(session, nodes, 0) != DONE) {
        return session->context->error;
    }
    if ((nodes && !points) || (session->nodes && nodes != session->nodes)) {
        mmi_fail(session->context, "INVALID_ARGUMENT.SHAPE", "mm_node_count returns it",
                 "the points must have %zu rows, got %zu", session->nodes, nodes);
        return session->context->error;
    }
    answer fetched = {0};
    request fetch = mmi_session_request(session, "FETCH", "FETCHED");
    mmi_add_text(&fetch, "what", which == MM_SINCE_REFERENCE ? "reference" : "committed");
    if (mmi_deliver(session, &fetch, session->context->timeout, &fetched) == DONE) {
        if (session->evaluates) {
            mmi_take_points(session, &fetched, points);
        } else {
            take_rows(session, &fetched, "points", nodes, 1, points);
        }
    }
    mmi_free_answer(&fetched);
    return session->context->error;
}

mm_result mm_status(mm_session *session)
{
    BEGIN_SESSION(session);
    if (mmi_check_joined(session) != DONE) {
        return session->context->error;
    }
    answer reported = {0};
    request ask_status = mmi_session_request(session, "STATUS", "STATUS_REPORT");
    if (mmi_deliver(session, &ask_status, session->context->timeout, &reported) == DONE) {
        mm_report_text(&reported.reply.report, "state", session->state, sizeof session->state);
        session->durable_step = mm_report_integer(&reported.reply.report, "durable_step", session->durable_step);
        mmi_keep_report(&session->status, &reported);
    }
    mmi_free_answer(&reported);
    return session->context->error;
}
