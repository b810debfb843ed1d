/* A session: its settings, how it is opened, joined and resumed, its credentials, its end. See mesh_motion.h. */
#define _POSIX_C_SOURCE 200809L

#include "mm_evaluation.h"
#include "mm_mesh.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* The size of one UPLOAD: the worker never holds much more than the mesh itself. */
#define PART_BYTES ((size_t)32 << 20)
#define START_SECONDS 300.0 /* the first session of a server waits until a worker has started */

/* --- a session and its settings ----------------------------------------------------------------------------------- */

mm_session *mm_session_new(mm_context *context)
{
    if (!context || context->error || (mmi_is_forked(context) && mmi_fail_forked(context))) {
        return NULL;
    }
    mm_session *session = calloc(1, sizeof *session);
    if (!session) {
        mmi_no_memory(context);
        return NULL;
    }
    session->context = context;
    session->partitions = 1;
    atomic_init(&session->data.lent, 0);
    snprintf(session->state, sizeof session->state, "NEW");
    if (mmi_new_line(context, &session->line) != DONE) {
        free(session);
        return NULL;
    }
    session->next = context->sessions;
    context->sessions = session;
    return session;
}

void mm_session_free(mm_session *session)
{
    if (!session) {
        return;
    }
    mm_session **link = &session->context->sessions;
    while (*link != session) {
        link = &(*link)->next;
    }
    *link = session->next;
    if (mmi_is_forked(session->context)) {
        mmi_abandon(&session->data);
    }
    mmi_disconnect(&session->data);
    mmi_free_blocks(session);
    mmi_forget_volume(session);
    free(session->blocks);
    free(session->settings);
    free(session->moving);
    free(session->patch_nodes);
    free(session->enrichment);
    free(session->velocity);
    free(session->swept);
    free(session->boundary_velocity);
    free(session->swept_faces);
    free(session->trial);
    mmi_report_free(&session->entered);
    mmi_report_free(&session->built);
    mmi_report_free(&session->moved);
    mmi_report_free(&session->committed);
    mmi_report_free(&session->status);
    free(session);
}

/* The place of a setting; a key that was set before keeps its place. */
static setting *place_of(mm_session *session, const char *key)
{
    setting *settings = session->settings;
    for (size_t i = 0; i < session->setting_count; ++i) {
        if (strcmp(settings[i].key, key) == 0) {
            return &settings[i];
        }
    }
    settings =
        mmi_one_more(session->context, settings, session->setting_count, &session->setting_capacity, sizeof *settings);
    if (!settings) {
        return NULL;
    }
    session->settings = settings;
    return &settings[session->setting_count++];
}

static mm_result set(mm_session *session, const char *key, setting value)
{
    if (!key || !*key || strlen(key) >= sizeof value.key || session->setting_count >= MMI_CONTAINER_ITEMS) {
        return mmi_invalid(session->context, "SPEC.md, section 14, lists the settings",
                           "there is no such setting: '%s'", key ? key : "");
    }
    setting *place = place_of(session, key);
    if (place) {
        snprintf(value.key, sizeof value.key, "%s", key);
        *place = value;
    }
    return session->context->error;
}

mm_result mm_set_number(mm_session *session, const char *key, double value)
{
    BEGIN_UNOPENED(session);
    if (!isfinite(value)) {
        return mmi_invalid(session->context, "leave it out for its default", "the setting '%s' must be finite",
                           key ? key : "");
    }
    setting made = {.kind = MMI_NUMBER, .number = value};
    return set(session, key, made);
}

mm_result mm_set_integer(mm_session *session, const char *key, int64_t value)
{
    BEGIN_UNOPENED(session);
    setting made = {.kind = MMI_INTEGER, .integer = value};
    return set(session, key, made);
}

mm_result mm_set_flag(mm_session *session, const char *key, int value)
{
    BEGIN_UNOPENED(session);
    setting made = {.kind = MMI_FLAG, .integer = value != 0};
    return set(session, key, made);
}

mm_result mm_set_text(mm_session *session, const char *key, const char *value)
{
    BEGIN_UNOPENED(session);
    setting made = {.kind = MMI_TEXT};
    if (!value || strlen(value) >= sizeof made.text) {
        return mmi_invalid(session->context, "leave it out for its default", "the setting '%s' has no such choice",
                           key ? key : "");
    }
    snprintf(made.text, sizeof made.text, "%s", value);
    return set(session, key, made);
}

mm_result mm_set_label(mm_session *session, const char *label)
{
    BEGIN_UNOPENED(session);
    if (!label || strlen(label) >= sizeof session->label) {
        return mmi_invalid(session->context, "give a shorter one", "a label has at most 256 bytes%s", "");
    }
    snprintf(session->label, sizeof session->label, "%s", label);
    return MM_OK;
}

mm_result mm_set_durability(mm_session *session, const char *durability)
{
    BEGIN_UNOPENED(session);
    if (!durability || strlen(durability) >= sizeof session->durability) {
        return mmi_invalid(session->context, "give full, replay or relaxed", "there is no such durability: '%s'",
                           durability ? durability : "");
    }
    snprintf(session->durability, sizeof session->durability, "%s", durability);
    return MM_OK;
}

mm_result mm_set_evaluation(mm_session *session, const char *evaluation)
{
    BEGIN_UNOPENED(session);
    if (!evaluation || (strcmp(evaluation, "server") != 0 && strcmp(evaluation, "client") != 0)) {
        return mmi_invalid(session->context, "give server or client", "evaluation is by server or client, got '%s'",
                           evaluation ? evaluation : "");
    }
    session->evaluates = strcmp(evaluation, "client") == 0;
    return MM_OK;
}

mm_result mm_set_partition(mm_session *session, int partition, int partitions)
{
    BEGIN_UNOPENED(session);
    if (partitions < 1 || partitions > 256 || partition < 0 || partition >= partitions) {
        mmi_fail(session->context, "INVALID_ARGUMENT.PARTITION", "give the rank and the number of ranks",
                 "partitions count from 0, at most 256; got %d of %d", partition, partitions);
        return session->context->error;
    }
    session->partition = partition;
    session->partitions = partitions;
    return MM_OK;
}

/* --- opening ------------------------------------------------------------------------------------------------------ */

static void add_settings(request *request, const mm_session *session)
{
    mmi_writer *out = &request->fields;
    ++request->field_count;
    mmi_put_text(out, "settings");
    mmi_put_map(out, session->setting_count);
    for (size_t i = 0; i < session->setting_count; ++i) {
        const setting *value = &session->settings[i];
        mmi_put_text(out, value->key);
        switch (value->kind) {
        case MMI_NUMBER: mmi_put_number(out, value->number); break;
        case MMI_INTEGER: mmi_put_integer(out, value->integer); break;
        case MMI_FLAG: mmi_put_flag(out, (int)value->integer); break;
        default: mmi_put_text(out, value->text);
        }
    }
}

/* The session is not built, or no longer. */
static void forget_moving_nodes(mm_session *session)
{
    free(session->moving);
    session->moving = NULL;
    session->moving_count = 0;
    free(session->patch_nodes);
    session->patch_nodes = NULL;
    session->patch_node_count = 0;
}

static outcome take_moving_nodes(mm_session *session, const answer *from)
{
    mm_context *context = session->context;
    const mmi_array *array = mmi_find_array(&from->reply, "moving_nodes");
    if (!array) {
        forget_moving_nodes(session);
        return DONE;
    }
    int64_t *moving = malloc((array->rows + 1) * sizeof *moving);
    /* at most three coordinates a node */
    double *trial = malloc((3 * array->rows + 1) * sizeof *trial);
    if (!moving || !trial) {
        free(moving);
        free(trial);
        return mmi_no_memory(context);
    }
    mmi_take_integers(moving, from, array);
    for (size_t i = 0; session->volume && i < array->rows; ++i) {
        moving[i] = mmi_in_mesh(session, moving[i]);
    }
    free(session->moving);
    free(session->trial);
    session->moving = moving;
    session->moving_count = array->rows;
    session->trial = trial;
    session->has_trial = 0;
    for (size_t i = 0; i < array->rows; ++i) {
        if (moving[i] < (i ? moving[i - 1] + 1 : 0) || (session->nodes && (uint64_t)moving[i] >= session->nodes)) {
            session->moving_count = 0;
            return mmi_fail(context, "INTERNAL", "", "the server's moving nodes are not nodes of this mesh, ascending");
        }
    }
    return DONE;
}

/* Keep JOINED, and the nodes of the moving patches that it names. */
static outcome keep_joined(mm_session *session, answer *joined)
{
    const mmi_array *array = mmi_find_array(&joined->reply, "patch_nodes");
    int64_t *nodes = array ? malloc((array->rows + 1) * sizeof *nodes) : NULL;
    if (array && !nodes) {
        return mmi_no_memory(session->context);
    }
    free(session->patch_nodes);
    session->patch_nodes = nodes;
    session->patch_node_count = array ? array->rows : 0;
    if (array) {
        mmi_take_integers(nodes, joined, array);
    }
    for (size_t i = 0; i < session->patch_node_count; ++i) {
        nodes[i] = session->volume ? mmi_in_mesh(session, nodes[i]) : nodes[i];
        if (nodes[i] < 0 || (session->nodes && (uint64_t)nodes[i] >= session->nodes)) {
            session->patch_node_count = 0;
            return mmi_fail(session->context, "INTERNAL", "", "a node of the server's moving patches is not in this mesh");
        }
    }
    mmi_keep_report(&session->entered, joined);
    return DONE;
}

/* Join with the endpoint in OPENED, RESUMED or PROBED, and take over the state in JOINED. */
static outcome join_by(mm_session *session, const answer *from, double deadline)
{
    mm_context *context = session->context;
    char endpoint[ENDPOINT_BYTES];
    answer joined = {0};
    mmi_data_endpoint(context, from, endpoint, sizeof endpoint);
    outcome how =
        mmi_join_worker(session, endpoint, mmi_integer_field(from, "epoch"), mmi_seconds_left(deadline), &joined);
    if (how == DONE) {
        int64_t dimension = mmi_integer_field(&joined, "dimension"), nodes = mmi_integer_field(&joined, "nodes");
        mm_report_text(&joined.reply.report, "state", session->state, sizeof session->state);
        session->iteration = mmi_integer_field(&joined, "iteration");
        session->joined = 1;
        if (dimension >= 1 && dimension <= 3) {
            session->dimension = (int)dimension;
        }
        session->evaluates = mmi_is_text(&joined.reply.report, mmi_field(&joined, "evaluation"), "client");
        if (nodes > 0 && !session->evaluates) {
            session->nodes = (size_t)nodes;
        }
        if (session->evaluates && mmi_find_array(&joined.reply, "moving_nodes")) { /* it is built */
            how = mmi_make_volume(session);
            mmi_free_blocks(session);
        }
        session->may_resume =
            mmi_find_array(&joined.reply, "moving_nodes") && mmi_integer_field(&joined, "partitions") == 1;
        how = how == DONE ? take_moving_nodes(session, &joined) : how;
        how = how == DONE ? mmi_take_step(session, mmi_integer_field(&joined, "step")) : how;
        how = how == DONE ? keep_joined(session, &joined) : how;
    }
    mmi_free_answer(&joined);
    return how;
}

static outcome open_session(mm_session *session, double deadline)
{
    mm_context *context = session->context;
    answer opened = {0};
    request ask_open = mmi_new_request("OPEN", "OPENED");
    mmi_add_integer(&ask_open, "dimension", session->dimension);
    mmi_add_integer(&ask_open, "partitions", session->partitions);
    add_settings(&ask_open, session);
    mmi_add_text(&ask_open, "label", session->label);
    int64_t reserved = session->partitions == 1 && !session->evaluates ? (int64_t)mmi_mesh_bytes(session) : 0;
    mmi_add_integer(&ask_open, "bytes_reserved", reserved);
    if (session->evaluates) {
        mmi_add_text(&ask_open, "evaluation", "client");
    }
    mmi_add_text(&ask_open, "durability", session->durability);
    mmi_add_levels(&ask_open, session);
    session->may_resume = session->joined = session->has_trial = 0;
    session->part = session->part_row = 0;
    session->reach = 0.0;
    session->step = session->durable_step = 0;
    forget_moving_nodes(session);
    outcome how = mmi_ask(context, &session->opening, &ask_open, mmi_seconds_left(deadline), &opened);
    if (how == DONE
        && mm_report_text(&opened.reply.report, "session", session->id, sizeof session->id) != MM_ID_SIZE - 1) {
        how = mmi_fail(context, "INTERNAL", "", "the server's session has an id that is not of 32 characters");
    }
    if (how == DONE) {
        const mm_report *report = &opened.reply.report;
        memcpy(session->token, report->bytes + report->nodes[mmi_field(&opened, "token")].u.offset, MM_TOKEN_BYTES);
        how = join_by(session, &opened, deadline);
    }
    mmi_free_answer(&opened);
    return how;
}

static outcome open_patiently(mm_session *session)
{
    const mm_context *context = session->context;
    double start = context->compute_timeout < START_SECONDS ? context->compute_timeout : START_SECONDS;
    double deadline = mmi_now() + (start > context->timeout ? start : context->timeout);
    outcome how = FAILED;
    for (int attempt = 0; attempt < OPEN_ATTEMPTS; ++attempt) {
        mm_clear_error(session->context);
        how = open_session(session, deadline);
        if (how == DONE || context->error != MM_UNAVAILABLE || mmi_seconds_left(deadline) <= PAUSE_SECONDS) {
            break;
        }
    }
    return how;
}

mm_result mm_open(mm_session *session)
{
    BEGIN_UNOPENED(session);
    if (!session->dimension) {
        return mmi_invalid(session->context, "give the mesh first: mm_points, mm_cells, mm_patch",
                           "mm_points must be called before mm_open%s", "");
    }
    if (mmi_check_has_server(session->context) == DONE) {
        open_patiently(session);
    }
    return session->context->error;
}

static outcome check_has_credentials(mm_session *session)
{
    if (mmi_check_has_server(session->context) != DONE) {
        return FAILED;
    }
    return session->id[0] ? DONE
                          : mmi_fail(session->context, "FAILED_PRECONDITION",
                                     "mm_set_credentials or mm_load_credentials", "there is no session to resume");
}

mm_result mm_join(mm_session *session)
{
    BEGIN_SESSION(session);
    mm_context *context = session->context;
    double deadline = mmi_now() + context->timeout;
    answer probed = {0};
    outcome how = check_has_credentials(session);
    while (how == DONE) {
        how = mmi_probe(session, mmi_seconds_left(deadline), &probed);
        if (how != DONE || mmi_is_text(&probed.reply.report, mmi_field(&probed, "worker"), "alive")) {
            break;
        }
        if (mmi_seconds_left(deadline) <= PAUSE_SECONDS) {
            how = mmi_fail(context, "UNAVAILABLE.WORKER", "resume the session from one partition first",
                           "the session has no worker");
        } else {
            mmi_pause_for(PAUSE_SECONDS / 4);
        }
    }
    if (how == DONE) {
        session->has_trial = 0;
        how = join_by(session, &probed, deadline);
    }
    if (how == DONE && session->volume) {
        mmi_check_reference(session);
    }
    mmi_free_answer(&probed);
    return context->error;
}

mm_result mm_resume(mm_session *session)
{
    BEGIN_SESSION(session);
    answer resumed = {0};
    double deadline = mmi_now() + session->context->compute_timeout;
    if (check_has_credentials(session) == DONE && mmi_resume(session, mmi_seconds_left(deadline), &resumed) == DONE) {
        session->has_trial = 0;
        session->durable_step = mmi_integer_field(&resumed, "step"); /* SPEC 21.3 */
        if (join_by(session, &resumed, deadline) == DONE && session->volume) {
            mmi_check_reference(session);
        }
    }
    mmi_free_answer(&resumed);
    return session->context->error;
}

/* --- upload ------------------------------------------------------------------------------------------------------- */

/* Continue after the end of the last call: the first UPLOAD is the one that was given up without an answer. */
static outcome upload(mm_session *session)
{
    outcome how = DONE;
    answer uploaded = {0};
    while (how == DONE && session->part < session->block_count) {
        block rows = session->blocks[session->part];
        /* the server stores 8 bytes for each */
        size_t most = rows.columns ? PART_BYTES / (8 * rows.columns) : rows.rows;
        size_t left = rows.rows - session->part_row;
        request part = mmi_session_request(session, "UPLOAD", "UPLOADED");
        mmi_add_text(&part, "item", rows.item);
        mmi_add_text(&part, "name", rows.name);
        mmi_add_text(&part, "role", rows.role);
        block *sent = &part.arrays[0];
        *sent = rows;
        sent->item = "rows";
        sent->rows = left < most ? left : most;
        sent->data = rows.data ? (const uint8_t *)rows.data + session->part_row * rows.columns * rows.width : NULL;
        how = mmi_deliver(session, &part, session->context->timeout, &uploaded);
        if (how == DONE) {
            session->part_row += sent->rows;
            if (session->part_row >= rows.rows) {
                ++session->part;
                session->part_row = 0;
            }
        }
        mmi_free_answer(&uploaded);
    }
    return how;
}

static outcome upload_and_build(mm_session *session)
{
    answer built = {0};
    outcome how = DONE;
    for (int is_asked = 1; how == DONE && is_asked;) { /* for more cells near moving walls (SPEC 23.2) */
        mmi_free_answer(&built);
        how = upload(session);
        if (how == DONE) {
            request ask_build = mmi_session_request(session, "BUILD", "BUILT");
            if (session->evaluates) {
                mmi_add_number(&ask_build, "reach", session->reach);
            }
            how = mmi_deliver(session, &ask_build, session->context->compute_timeout, &built);
        }
        double reach = how == DONE ? mm_report_number(&built.reply.report, "reach") : 0.0;
        is_asked = reach > 0.0;
        if (is_asked) {
            session->reach = reach;
            how = mmi_add_near_cells(session, &built);
        }
    }
    if (how == DONE) {
        how = take_moving_nodes(session, &built);
    }
    if (how == DONE) {
        session->step = session->durable_step = session->iteration = 0;
        session->may_resume = session->partitions == 1;
        mmi_free_blocks(session); /* from now on the caller may free the arrays */
        snprintf(session->state, sizeof session->state, "READY");
        mmi_keep_report(&session->built, &built);
    }
    mmi_free_answer(&built);
    return how;
}

/* Discard a session whose mesh was refused. The error of the call stays that of the refusal. */
static void discard_quietly(mm_session *session)
{
    mm_context *context = session->context;
    mm_result error = context->error;
    problem kept = context->problem;
    answer closed = {0};
    request close = mmi_session_request(session, "CLOSE", "CLOSED");
    mmi_add_text(&close, "outcome", "discard");
    context->problem.details = (mm_report){0};
    mmi_deliver(session, &close, PROBE_SECONDS, &closed);
    mmi_free_answer(&closed);
    mmi_disconnect(&session->data);
    session->joined = 0;
    mm_clear_error(context);
    context->error = error;
    context->problem = kept;
}

mm_result mm_build(mm_session *session)
{
    BEGIN_SESSION(session);
    mm_context *context = session->context;
    if (mmi_check_joined(session) == DONE && session->moving) {
        /* checked here, not by the server: a refused session is discarded below, but this session is in use */
        mmi_fail(context, "FAILED_PRECONDITION.STATE", "make another session for another mesh",
                 "the session is built already");
    }
    if (context->error || mmi_check_mesh(session) != DONE) {
        return context->error;
    }
    outcome how = FAILED;
    if (session->evaluates && (mmi_make_volume(session) != DONE || mmi_gather_blocks(session) != DONE)) {
        return context->error;
    }
    for (int attempt = 1;; ++attempt) {
        how = upload_and_build(session);
        /* SPEC 11.6: a session that was not built is lost with its worker, so another one is opened */
        int is_gone = context->error == MM_UNAVAILABLE || context->error == MM_NOT_FOUND;
        if (!is_gone || session->partitions > 1 || attempt == OPEN_ATTEMPTS) {
            break;
        }
        if (open_patiently(session) != DONE) {
            break;
        }
    }
    if (how != DONE && session->partitions == 1 && session->joined && !mmi_is_unknown(context)) {
        discard_quietly(session);
    }
    return context->error;
}

/* --- credentials -------------------------------------------------------------------------------------------------- */

const char *mm_id(const mm_session *session) { return session ? session->id : ""; }
const uint8_t *mm_token(const mm_session *session) { return session ? session->token : NULL; }

mm_result mm_set_credentials(mm_session *session, const char *id, const uint8_t token[MM_TOKEN_BYTES])
{
    BEGIN_SESSION(session);
    if (!id || strlen(id) != MM_ID_SIZE - 1 || !token) {
        return mmi_invalid(session->context, "give what mm_id and mm_token returned",
                           "a session's id has 32 characters, and there must be its token%s", "");
    }
    if (strcmp(session->id, id) != 0) { /* forget the state of the session before */
        mmi_disconnect(&session->data);
        mmi_forget_accepted(session);
        forget_moving_nodes(session);
        session->joined = session->may_resume = session->has_trial = 0;
        session->part = session->part_row = 0;
        session->step = session->durable_step = session->iteration = 0;
    }
    memcpy(session->id, id, MM_ID_SIZE);
    memcpy(session->token, token, MM_TOKEN_BYTES);
    return MM_OK;
}

mm_result mm_save_credentials(mm_session *session, const char *path)
{
    BEGIN_SESSION(session);
    if (!session->id[0]) {
        mmi_fail(session->context, "FAILED_PRECONDITION.STATE", "mm_open first", "there is no session to save");
        return session->context->error;
    }
    char part[4096], text[160];
    int used = snprintf(text, sizeof text, "{\"session\": \"%s\", \"token\": \"", session->id);
    for (size_t i = 0; i < MM_TOKEN_BYTES; ++i) {
        used += snprintf(text + used, sizeof text - (size_t)used, "%02x", session->token[i]);
    }
    used += snprintf(text + used, sizeof text - (size_t)used, "\"}\n");
    /* written to another file first: with a truncated file the session would be lost */
    int length = path ? snprintf(part, sizeof part, "%s.part", path) : -1;
    if (length < 0 || (size_t)length >= sizeof part) {
        return mmi_invalid(session->context, "give a path of at most 4090 bytes",
                           "the credentials need a path%s", "");
    }
    /* a file from an earlier attempt, or from another user, could have another mode and owner */
    unlink(part);
    int file = open(part, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
    int written = file >= 0 && write(file, text, (size_t)used) == (ssize_t)used && fsync(file) == 0;
    written = file >= 0 && close(file) == 0 && written;
    if (!written || rename(part, path) != 0) {
        mmi_fail(session->context, "INVALID_ARGUMENT", "give a path in a folder that this user may write to",
                 "%s: cannot be written: %s", path, strerror(errno));
    }
    return session->context->error;
}

mm_result mm_load_credentials(mm_session *session, const char *path)
{
    BEGIN_SESSION(session);
    char text[512], id[MM_ID_SIZE], hex[2 * MM_TOKEN_BYTES + 1];
    uint8_t token[MM_TOKEN_BYTES];
    FILE *file = path ? fopen(path, "r") : NULL;
    size_t size = file ? fread(text, 1, sizeof text - 1, file) : 0;
    if (file) {
        fclose(file);
    }
    text[size] = '\0';
    if (sscanf(text, " { \"session\" : \"%32[0-9a-f]\" , \"token\" : \"%64[0-9a-f]\" }", id, hex) != 2
        || strlen(hex) != 2 * MM_TOKEN_BYTES) {
        return mmi_invalid(session->context, "give a file that mm_save_credentials wrote",
                           "%s must hold a session and a token", path ? path : "the credentials");
    }
    for (size_t i = 0; i < MM_TOKEN_BYTES; ++i) {
        unsigned byte = 0;
        sscanf(hex + 2 * i, "%2x", &byte);
        token[i] = (uint8_t)byte;
    }
    return mm_set_credentials(session, id, token);
}

/* --- the end, and the state without a request --------------------------------------------------------------------- */

mm_result mm_close(mm_session *session, mm_outcome outcome_wanted)
{
    BEGIN_SESSION(session);
    if (!session->joined) {
        return MM_OK;
    }
    answer closed = {0};
    request close = mmi_session_request(session, "CLOSE", "CLOSED");
    mmi_add_text(&close, "outcome", outcome_wanted == MM_DISCARD ? "discard" : "keep");
    outcome how = mmi_deliver(session, &close, session->context->timeout, &closed);
    /* another client has the session, or it is deleted already: nothing is left to close */
    if (how != DONE
        && (mm_error_is(session->context, "ABORTED.FENCED")
            || (outcome_wanted == MM_DISCARD && mm_error_is(session->context, "NOT_FOUND")))) {
        mm_clear_error(session->context);
        how = DONE;
    }
    if (how == DONE) {
        session->joined = session->may_resume = session->has_trial = 0;
        snprintf(session->state, sizeof session->state, "CLOSED");
        mmi_disconnect(&session->data);
    }
    mmi_free_answer(&closed);
    return session->context->error;
}

int mm_dimension(const mm_session *session) { return session ? session->dimension : 0; }
size_t mm_node_count(const mm_session *session) { return session ? session->nodes : 0; }
int64_t mm_step(const mm_session *session) { return session ? session->step : 0; }
int64_t mm_durable_step(const mm_session *session) { return session ? session->durable_step : 0; }
int64_t mm_iteration(const mm_session *session) { return session ? session->iteration : 0; }
const char *mm_state(const mm_session *session) { return session ? session->state : ""; }
const uint8_t *mm_digest(const mm_session *session) { return session ? session->digest : NULL; }
const mm_report *mm_joined(const mm_session *session) { return session ? &session->entered : NULL; }
const mm_report *mm_built(const mm_session *session) { return session ? &session->built : NULL; }
const mm_report *mm_moved(const mm_session *session) { return session ? &session->moved : NULL; }
const mm_report *mm_committed(const mm_session *session) { return session ? &session->committed : NULL; }
const mm_report *mm_status_report(const mm_session *session) { return session ? &session->status : NULL; }

const int64_t *mm_moving_nodes(const mm_session *session, size_t *count)
{
    if (count) {
        *count = session ? session->moving_count : 0;
    }
    return session ? session->moving : NULL;
}

const int64_t *mm_patch_nodes(const mm_session *session, const char *name, size_t *count)
{
    size_t first = 0, size = 0;
    int found = 0;
    for (size_t i = 0; session && name && !found && i < mm_report_count(&session->entered, "moving_patches"); ++i) {
        char path[64], text[NAME_BYTES];
        snprintf(path, sizeof path, "moving_patches.%zu.0", i);
        mm_report_text(&session->entered, path, text, sizeof text);
        snprintf(path, sizeof path, "moving_patches.%zu.1", i);
        first += size;
        int64_t nodes = mm_report_integer(&session->entered, path, 0);
        size = nodes > 0 ? (size_t)nodes : 0;
        found = strcmp(text, name) == 0 && first <= session->patch_node_count && size <= session->patch_node_count - first;
    }
    if (count) {
        *count = found ? size : 0;
    }
    return found ? session->patch_nodes + first : NULL;
}

const double *mm_enrichment_points(const mm_session *session, size_t *count)
{
    if (count) {
        *count = session ? session->enrichment_count : 0;
    }
    return session ? session->enrichment : NULL;
}
