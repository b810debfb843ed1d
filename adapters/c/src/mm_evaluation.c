/* Evaluation by the client (SPEC.md, section 23): this process moves its nodes and computes their quality. */
#include "mm_evaluation.h"
#include "mm_mesh.h"

#ifdef MM_EVALUATION

#include "mm_volume.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define FEW_VALUES 512
#define MOST_QUESTIONS 200
#define MOST_DIVISIONS 6

/* Send a request that owns its arrays, and keep it for a lost trial if its reply `is_accepted`. */
static outcome deliver_own(mm_session *session, request *made, int (*is_accepted)(const mm_report *), answer *got)
{
    request sent = *made; /* mmi_deliver frees the fields of its request */
    sent.fields = (mmi_writer){0};
    mmi_put_raw(&sent.fields, made->fields.data, made->fields.size);
    outcome how = mmi_deliver(session, &sent, session->context->compute_timeout, got);
    if (how == DONE && is_accepted(&got->reply.report)) {
        session->accepted[session->accepted_count++] = *made;
        *made = (request){0};
    }
    mmi_free_request(made);
    return how;
}

void mmi_keep_freed(mm_session *session)
{
    freed kept = session->trial_freed;
    session->trial_freed = (freed){0};
    mmi_forget_accepted(session);
    mmi_free_freed(&session->committed_freed);
    session->committed_freed = kept;
}

static int is_answered(const mm_report *judged) { return !mm_report_count(judged, "questions"); }
static int is_corrected(const mm_report *corrected) { return !mm_report_count(corrected, "region"); }
static int is_never_kept(const mm_report *report)
{
    (void)report;
    return 0;
}

/* A bin that the server asks for: a metric, and the divisions that lead to the bin. */
typedef struct {
    char metric[32];
    int divisions;
    double way[MOST_DIVISIONS][3];
} question;

static outcome kernels_failed(const mm_session *session, int result)
{
    const char *code = result == MESH_MOTION_INVALID_ARGUMENT ? "INVALID_ARGUMENT.MESH"
                       : result == MESH_MOTION_OUT_OF_MEMORY  ? "RESOURCE_EXHAUSTED.MEMORY"
                                                              : "INTERNAL";
    const char *message = mesh_motion_kernels_error();
    return mmi_fail(session->context, code, "", "%s",
                    *message ? message : "the field of the server does not fit together");
}

outcome mmi_make_volume(mm_session *session)
{
    mm_context *context = session->context;
    if (session->volume || !session->evaluates) {
        return DONE;
    }
    if (!session->block_count) {
        return mmi_fail(context, "INVALID_ARGUMENT", "mm_points, mm_cells and mm_patch before mm_join or mm_resume",
                        "the volume of this session stays with the client, and the mesh is not known here");
    }
    mmv_volume *volume = mmv_new(session->dimension, session->nodes, session->blocks[0].data);
    int result = volume ? MESH_MOTION_OK : MESH_MOTION_OUT_OF_MEMORY;
    for (size_t i = 1; result == MESH_MOTION_OK && i < session->block_count; ++i) {
        const block *part = &session->blocks[i];
        if (strcmp(part->item, "cells") == 0) {
            result = mmv_add_cells(volume, part->name, part->rows, part->columns, part->data, part->width);
        } else if (strcmp(part->item, "patch") == 0) {
            mmv_add_patch(volume, part->rows, part->data);
        } else if (strcmp(part->item, "global_ids") == 0) {
            result = mmv_set_ids(volume, part->data);
        }
    }
    int64_t alone = result == MESH_MOTION_OK ? mmv_without_cell(volume) : -1;
    if (alone >= 0) {
        mmv_free(volume);
        return mmi_fail(context, "INVALID_ARGUMENT.MESH",
                        "leave it out, or open the session with evaluation = 'server'",
                        "evaluation = 'client': node %lld is in no cell of this partition", (long long)alone);
    }
    result = result == MESH_MOTION_OK ? mmv_finish(volume) : result;
    if (result != MESH_MOTION_OK) {
        mmv_free(volume);
        return kernels_failed(session, result);
    }
    session->volume = volume;
    return DONE;
}

/* Copy the rows of the uploaded nodes out of the caller's array. */
static outcome gather_rows(mm_session *session, block *part)
{
    size_t count, row = part->columns * part->width;
    const int64_t *nodes = mmv_uploaded(session->volume, &count);
    uint8_t *rows = malloc(count * row + 1);
    if (!rows) {
        return mmi_no_memory(session->context);
    }
    for (size_t i = 0; i < count; ++i) {
        memcpy(rows + i * row, (const uint8_t *)part->data + (size_t)nodes[i] * row, row);
    }
    part->data = part->owned = rows;
    part->rows = count;
    return DONE;
}

/* Add rows with 8 bytes for each item, which the caller fills; NULL after an error. */
static void *add_rows(mm_session *session, const char *item, const char *name, size_t rows, size_t columns)
{
    void *data = malloc(rows * columns * 8 + 1);
    block made = mmi_make_block(item, NULL, rows, columns, 8);
    snprintf(made.name, sizeof made.name, "%s", name);
    made.is_float = strcmp(item, "nodes") == 0;
    made.data = made.owned = data;
    if (!data) {
        mmi_no_memory(session->context);
    } else if (mmi_add_block(session, &made) != MM_OK) {
        free(data);
        data = NULL;
    }
    return data;
}

static outcome add_facets(mm_session *session, size_t corners)
{
    static const char *const TYPES[] = {"vertex", "line", "triangle", "quad"};
    size_t count = mmv_count_facets(session->volume, corners);
    int64_t *rows = count ? add_rows(session, "facets", TYPES[corners - 1], count, corners) : NULL;
    if (rows) {
        mmv_copy_facets(session->volume, corners, rows);
    }
    return session->context->error ? FAILED : DONE;
}

outcome mmi_gather_blocks(mm_session *session)
{
    size_t count, had = session->block_count;
    const int64_t *nodes = mmv_uploaded(session->volume, &count);
    outcome how = DONE;
    int has_ids = 0;
    if (session->blocks[0].owned) {
        return DONE; /* done by an earlier call */
    }
    for (size_t i = 0; how == DONE && i < had; ++i) {
        block *part = &session->blocks[i];
        has_ids = has_ids || strcmp(part->item, "global_ids") == 0;
        if (strcmp(part->item, "cells") == 0) {
            part->columns = 0;
            part->data = NULL;
        } else if (strcmp(part->item, "patch") == 0) {
            int64_t *rows = malloc((part->rows + 1) * sizeof *rows);
            for (size_t k = 0; rows && k < part->rows; ++k) {
                rows[k] = mmv_row_of(session->volume, ((const int64_t *)part->data)[k]);
            }
            part->data = part->owned = rows;
            how = rows ? DONE : mmi_no_memory(session->context);
        } else {
            how = gather_rows(session, part);
        }
    }
    if (how == DONE && !has_ids) {
        block ids = mmi_make_block("global_ids", nodes, count, 1, 8);
        how = mmi_add_block(session, &ids) == MM_OK ? DONE : FAILED;
    }
    for (size_t corners = 1; how == DONE && corners <= 4; ++corners) {
        how = add_facets(session, corners);
    }
    return how;
}

static outcome copy_array(mm_context *context, const answer *from, const char *name, double **to, size_t *rows)
{
    const mmi_array *array = mmi_find_array(&from->reply, name);
    *rows = array ? array->rows : 0;
    *to = malloc((array ? array->rows * array->columns : 0) * sizeof **to + 1);
    if (!*to) {
        return mmi_no_memory(context);
    }
    if (array) {
        mmi_take_numbers(*to, from, array);
    }
    return DONE;
}

/* Add the uploaded nodes after the first `had`. */
static outcome add_nodes(mm_session *session, size_t had)
{
    size_t count, d = (size_t)session->dimension;
    const int64_t *nodes = mmv_uploaded(session->volume, &count);
    double *points = count > had ? add_rows(session, "nodes", "", count - had, d) : NULL;
    int64_t *ids = points ? add_rows(session, "global_ids", "", count - had, 1) : NULL;
    for (size_t i = had; ids && i < count; ++i) {
        memcpy(points + (i - had) * d, mmv_points(session->volume) + (size_t)nodes[i] * d, d * sizeof *points);
        ids[i - had] = mmv_id_of(session->volume, nodes[i]);
    }
    return session->context->error ? FAILED : DONE;
}

outcome mmi_add_near_cells(mm_session *session, const answer *built)
{
    const mmi_array *array = mmi_find_array(&built->reply, "wall");
    const mesh_motion_region *region = NULL;
    size_t had, facets, d = (size_t)session->dimension;
    int64_t *rows = NULL;
    double *wall = NULL;
    if (!array || array->columns != d * d) {
        return mmi_fail(session->context, "INTERNAL", "", "the server's wall must have %zu columns, got %zu", d * d,
                        array ? array->columns : 0);
    }
    mmv_uploaded(session->volume, &had);
    outcome how = copy_array(session->context, built, "wall", &wall, &facets);
    if (how == DONE) {
        int result = mmv_near(session->volume, facets, wall, session->reach, &region, &rows);
        how = result == MESH_MOTION_OK ? add_nodes(session, had) : kernels_failed(session, result);
    }
    const int64_t *next = rows;
    for (int i = 0; how == DONE && i < 7; ++i) {
        size_t cells = (size_t)region->cells[i], corners = mmi_corners_of(region->names[i]);
        int64_t *own = cells ? add_rows(session, "near_cells", region->names[i], cells, corners) : NULL;
        how = session->context->error ? FAILED : DONE;
        if (own) {
            memcpy(own, next, cells * corners * sizeof *own);
            next += cells * corners;
        }
    }
    mesh_motion_region_free(region);
    free(rows);
    free(wall);
    return how;
}

static void read_sum(const mm_report *report, size_t number, mmv_sum *sum)
{
    char path[48];
    snprintf(path, sizeof path, "sums.%zu.basis", number);
    mm_report_text(report, path, sum->basis, sizeof sum->basis);
    snprintf(path, sizeof path, "sums.%zu.radius", number);
    sum->radius = mm_report_number(report, path);
    snprintf(path, sizeof path, "sums.%zu.centres", number);
    sum->centres = mm_report_integer(report, path, -1);
    snprintf(path, sizeof path, "sums.%zu.inverse_side", number);
    sum->inverse_side = mm_report_number(report, path);
    snprintf(path, sizeof path, "sums.%zu.extent", number);
    sum->extent = mm_report_number(report, path);
    for (int axis = 0; axis < 3; ++axis) {
        snprintf(path, sizeof path, "sums.%zu.origin.%d", number, axis);
        sum->origin[axis] = mm_report_number(report, path);
        snprintf(path, sizeof path, "sums.%zu.shape.%d", number, axis);
        sum->shape[axis] = mm_report_integer(report, path, 0);
    }
    snprintf(path, sizeof path, "sums.%zu.scale", number);
    sum->scale = mm_report_number(report, path);
    sum->has_polynomial = !isnan(sum->scale);
    for (int axis = 0; sum->has_polynomial && axis < 3; ++axis) {
        snprintf(path, sizeof path, "sums.%zu.centre.%d", number, axis);
        sum->centre[axis] = mm_report_number(report, path);
    }
    sum->scale = sum->has_polynomial ? sum->scale : 0.0;
}

/* The displacement of all nodes from the reference mesh, by the field of a reply and the rows of the uploaded nodes. */
static outcome evaluate(mm_session *session, const answer *from, const double *known, double *to)
{
    mm_context *context = session->context;
    const mm_report *report = &from->reply.report;
    mmv_field field = {0};
    field.sum_count = mm_report_count(report, "sums");
    field.sums = calloc(field.sum_count + 1, sizeof *field.sums);
    if (!field.sums) {
        return mmi_no_memory(context);
    }
    for (size_t i = 0; i < field.sum_count; ++i) {
        read_sum(report, i, &field.sums[i]);
    }
    copy_array(context, from, "centres", &field.centres, &field.centre_count);
    copy_array(context, from, "boxes", &field.boxes, &field.box_count);
    copy_array(context, from, "coefficients", &field.coefficients, &field.coefficient_count);
    int result = mmv_set_field(session->volume, field);
    if (context->error) {
        return FAILED;
    }
    result = result == MESH_MOTION_OK ? mmv_displacement(session->volume, known, to) : result;
    return result == MESH_MOTION_OK ? DONE : kernels_failed(session, result);
}

/* Copy a reply's rows of the uploaded nodes into an array that the caller frees. */
static outcome take_uploaded(mm_session *session, const answer *from, const char *name, double **rows)
{
    const mmi_array *array = mmi_find_array(&from->reply, name);
    size_t count, copied;
    mmv_uploaded(session->volume, &count);
    if (array->rows != count || array->columns != (size_t)session->dimension) {
        return mmi_fail(session->context, "INVALID_ARGUMENT",
                        "give the same points, cells and patches in the same order",
                        "the mesh is not the one that this session was opened with");
    }
    return copy_array(session->context, from, name, rows, &copied);
}

/* A table that grows when rows are appended. */
typedef struct {
    void *data;
    size_t rows, capacity, row;
    int failed;
} table;

static void append(table *to, const void *row)
{
    if (to->rows == to->capacity) {
        size_t larger = to->capacity ? 2 * to->capacity : 1024;
        void *grown = realloc(to->data, larger * to->row);
        to->failed = to->failed || !grown;
        if (!grown) {
            return;
        }
        to->data = grown;
        to->capacity = larger;
    }
    memcpy((uint8_t *)to->data + to->rows++ * to->row, row, to->row);
}

/* Append the counts and values of the cells in the bin of question `number`. */
static outcome count_bin(mm_session *session, const question *asked, size_t number, table *bins, table *values)
{
    static const int64_t MOST = 1 << 20;
    int64_t counts[MESH_MOTION_BINS], different = 0, room = FEW_VALUES;
    double *found = NULL;
    int64_t *repeated = NULL;
    int result = MESH_MOTION_OK;
    do {
        room = different > room ? different : room;
        free(found);
        free(repeated);
        found = malloc((size_t)room * sizeof *found);
        repeated = malloc((size_t)room * sizeof *repeated);
        result = found && repeated ? mesh_motion_tally_bin(mmv_tally(session->volume), asked->metric, asked->divisions,
                                                           &asked->way[0][0], counts, room, found, repeated, &different)
                                   : MESH_MOTION_OUT_OF_MEMORY;
    } while (result == MESH_MOTION_OK && different > room && different <= MOST);
    for (int32_t bin = 0; result == MESH_MOTION_OK && bin < MESH_MOTION_BINS; ++bin) {
        if (counts[bin]) {
            int32_t row[] = {(int32_t)number, bin, (int32_t)counts[bin]};
            append(bins, row);
        }
    }
    for (int64_t i = 0; result == MESH_MOTION_OK && i < different; ++i) {
        double row[] = {(double)number, found[i], (double)repeated[i]};
        append(values, row);
    }
    free(found);
    free(repeated);
    return result == MESH_MOTION_OK ? DONE : kernels_failed(session, result);
}

static void put_metrics(mmi_writer *out, const char *key, const mesh_motion_part *part, const double *values)
{
    mmi_put_text(out, key);
    mmi_put_map(out, (size_t)part->metrics);
    for (int64_t i = 0; i < part->metrics; ++i) {
        mmi_put_text(out, part->names[i]);
        mmi_put_number(out, values[i]);
    }
}

static void put_question(mmi_writer *out, const question *asked)
{
    mmi_put_map(out, 2);
    mmi_put_text(out, "metric");
    mmi_put_text(out, asked->metric);
    mmi_put_text(out, "way");
    mmi_put_array(out, (size_t)asked->divisions);
    for (int i = 0; i < asked->divisions; ++i) {
        mmi_put_array(out, 3);
        mmi_put_number(out, asked->way[i][0]);
        mmi_put_number(out, asked->way[i][1]);
        mmi_put_integer(out, (int64_t)asked->way[i][2]);
    }
}

/* A JUDGE with the answers to `count` questions. */
static outcome make_judge(mm_session *session, const mesh_motion_part *part, const question *asked, size_t count,
                          request *judge)
{
    table bins = {0}, values = {0}, worst = {0};
    outcome how = DONE;
    bins.row = 3 * sizeof(int32_t);
    values.row = 3 * sizeof(double);
    worst.row = (6 + (size_t)session->dimension) * sizeof(double);
    for (size_t i = 0; how == DONE && i < count; ++i) {
        how = count_bin(session, &asked[i], i, &bins, &values);
    }
    for (int64_t i = 0; i < part->worst_cells; ++i) {
        append(&worst, part->worst[i]);
    }
    *judge = mmi_session_request(session, "JUDGE", "JUDGED");
    mmi_add_integer(judge, "step", session->step + 1);
    judge->field_count += 2;
    mmi_writer *out = &judge->fields;
    mmi_put_text(out, "part");
    mmi_put_map(out, 4);
    mmi_put_text(out, "cells");
    mmi_put_integer(out, part->cells);
    mmi_put_text(out, "inverted");
    mmi_put_integer(out, part->inverted);
    put_metrics(out, "sums", part, part->sums);
    put_metrics(out, "minima", part, part->minima);
    mmi_put_text(out, "questions");
    mmi_put_array(out, count);
    for (size_t i = 0; i < count; ++i) {
        put_question(out, &asked[i]);
    }
    const table *const tables[] = {&bins, &values, &worst};
    static const char *const NAMES[] = {"bins", "values", "worst"};
    for (int i = 0; i < 3; ++i) {
        size_t width = i ? sizeof(double) : sizeof(int32_t);
        judge->arrays[i] = mmi_make_block(NAMES[i], tables[i]->data, tables[i]->rows, tables[i]->row / width, width);
        judge->arrays[i].is_float = i > 0;
        judge->arrays[i].owned = tables[i]->data;
        how = how == DONE && tables[i]->failed ? mmi_no_memory(session->context) : how;
    }
    return how;
}

static outcome read_question(mm_context *context, const mm_report *report, size_t number, question *to)
{
    char path[64];
    snprintf(path, sizeof path, "questions.%zu.metric", number);
    mm_report_text(report, path, to->metric, sizeof to->metric);
    snprintf(path, sizeof path, "questions.%zu.way", number);
    to->divisions = (int)mm_report_count(report, path);
    if (to->divisions > MOST_DIVISIONS) {
        return mmi_fail(context, "INTERNAL", "", "the server asks for a bin of %d divisions", to->divisions);
    }
    for (int i = 0; i < to->divisions; ++i) {
        for (int k = 0; k < 3; ++k) {
            snprintf(path, sizeof path, "questions.%zu.way.%d.%d", number, i, k);
            to->way[i][k] = mm_report_number(report, path);
        }
    }
    return DONE;
}

/* The region of cells that the next CORRECT sends. */
typedef struct {
    char metric[32];
    double below;
    int64_t rings;
} extent;

/* Read the region that a reply asks for. Returns 0 if it asks for none. */
static int read_extent(const mm_report *report, extent *to)
{
    mm_report_text(report, "region.metric", to->metric, sizeof to->metric);
    to->below = mm_report_number(report, "region.below");
    to->rings = mm_report_integer(report, "region.rings", 0);
    return !isnan(to->below);
}

/* Compute the quality of the cells with the nodes displaced, and send JUDGE until the server has no more questions. */
static outcome judge_trial(mm_session *session, const char *metric, const double *displacement, extent *region,
                           int *is_bad)
{
    mm_context *context = session->context;
    mesh_motion_part part;
    int result = mmv_judge(session->volume, displacement, metric, &part);
    question *asked = calloc(MOST_QUESTIONS, sizeof *asked);
    size_t count = 0;
    outcome how = result != MESH_MOTION_OK ? kernels_failed(session, result) : asked ? DONE : mmi_no_memory(context);
    for (; how == DONE && count < (size_t)part.metrics; ++count) {
        snprintf(asked[count].metric, sizeof asked[count].metric, "%s", part.names[count]);
    }
    for (int is_over = 0; how == DONE && !is_over;) {
        answer judged = {0};
        request judge = {0};
        how = make_judge(session, &part, asked, count, &judge);
        if (how == DONE) {
            how = deliver_own(session, &judge, is_answered, &judged);
        } else {
            mmi_free_request(&judge);
        }
        size_t further = how == DONE ? mm_report_count(&judged.reply.report, "questions") : 0;
        if (count + further > MOST_QUESTIONS) {
            how = mmi_fail(context, "INTERNAL", "", "the server asks %zu questions", count + further);
        }
        for (size_t i = 0; how == DONE && i < further; ++i) {
            how = read_question(context, &judged.reply.report, i, &asked[count++]);
        }
        if (how == DONE && !further) {
            *is_bad = read_extent(&judged.reply.report, region);
            mmi_keep_report(&session->moved, &judged);
            is_over = 1;
        }
        mmi_free_answer(&judged);
    }
    free(asked);
    return how;
}

static void put_numbered(mmi_writer *out, const char *key, int64_t value)
{
    mmi_put_text(out, key);
    mmi_put_integer(out, value);
}

/* An array that the request frees. */
static void *own_array(request *to, int place, const char *name, size_t rows, size_t columns, size_t width)
{
    void *data = malloc(rows * columns * width + 1);
    to->arrays[place] = mmi_make_block(name, data, rows, columns, width);
    to->arrays[place].owned = data;
    return data;
}

/* A CORRECT with the nodes and cells of a region. */
static outcome make_correct(mm_session *session, const char *what, const extent *asked,
                            const mesh_motion_region *region, const double *positions, request *correct)
{
    size_t d = (size_t)session->dimension, nodes = (size_t)region->nodes, uploaded, types = 0;
    mmi_writer *out = &correct->fields;
    *correct = mmi_session_request(session, "CORRECT", "CORRECTED");
    mmi_add_integer(correct, "step", session->step + 1);
    mmi_add_text(correct, "what", what);
    ++correct->field_count;
    mmv_uploaded(session->volume, &uploaded);
    mmi_put_text(out, "part");
    mmi_put_map(out, 6);
    mmi_put_text(out, "metric");
    mmi_put_text(out, asked->metric);
    mmi_put_text(out, "below");
    mmi_put_number(out, asked->below);
    put_numbered(out, "rings", asked->rings);
    put_numbered(out, "interior", (int64_t)(session->nodes - uploaded));
    mmi_put_text(out, "least");
    mmi_put_array(out, 2);
    mmi_put_number(out, region->least_skew);
    mmi_put_number(out, region->least_size);
    for (int i = 0; i < 7; ++i) {
        types += region->cells[i] > 0;
    }
    mmi_put_text(out, "cells");
    mmi_put_map(out, types);
    for (int i = 0; i < 7; ++i) {
        if (region->cells[i]) {
            put_numbered(out, region->names[i], region->cells[i]);
        }
    }
    int64_t *numbers = own_array(correct, 0, "nodes", nodes, 2, sizeof *numbers);
    double *points = own_array(correct, 1, "points", nodes, d, sizeof *points);
    double *there = own_array(correct, 2, "positions", nodes, d, sizeof *there);
    correct->arrays[1].is_float = correct->arrays[2].is_float = 1;
    int32_t *corners = own_array(correct, 3, "corners", (size_t)region->corners, 1, sizeof *corners);
    if (!numbers || !points || !there || !corners) {
        return mmi_no_memory(session->context);
    }
    for (size_t i = 0; i < nodes; ++i) {
        size_t node = (size_t)region->indices[i];
        numbers[2 * i] = mmv_id_of(session->volume, region->indices[i]);
        numbers[2 * i + 1] = region->whole[i];
        memcpy(points + i * d, mmv_points(session->volume) + node * d, d * sizeof *points);
        memcpy(there + i * d, positions + node * d, d * sizeof *there);
    }
    for (int64_t i = 0; i < region->corners; ++i) {
        corners[i] = (int32_t)region->rows[i];
    }
    return DONE;
}

/* Store the nodes of a region that the server does not know. */
static outcome keep_sent(mm_session *session, const mesh_motion_region *region, freed *to)
{
    free(to->sent);
    to->sent = malloc(((size_t)region->nodes + 1) * sizeof *to->sent);
    to->sent_count = 0;
    for (int64_t i = 0; to->sent && i < region->nodes; ++i) {
        if (!mmv_is_uploaded(session->volume, region->indices[i])) {
            to->sent[to->sent_count++] = region->indices[i];
        }
    }
    return to->sent ? DONE : mmi_no_memory(session->context);
}

/* Read the nodes and displacements of CORRECTED. Nodes have their numbers in the whole mesh. */
static outcome read_corrected(mm_session *session, const answer *from, freed *to)
{
    const mmi_array *nodes = mmi_find_array(&from->reply, "nodes");
    const mmi_array *rows = mmi_find_array(&from->reply, "displacement");
    if (rows->rows && (rows->rows != nodes->rows || rows->columns != (size_t)session->dimension)) {
        return mmi_fail(session->context, "INTERNAL", "", "the server's correction does not fit together");
    }
    size_t copied;
    to->count = nodes->rows;
    to->nodes = malloc((nodes->rows + 1) * sizeof *to->nodes);
    if (!to->nodes || copy_array(session->context, from, "displacement", &to->displacement, &copied) != DONE) {
        return mmi_no_memory(session->context);
    }
    mmi_take_integers(to->nodes, from, nodes);
    return DONE;
}

/* Send the bad cells and their neighbours until the server has corrected them. */
static outcome correct(mm_session *session, const char *what, const double *known, extent asked, freed *found)
{
    outcome how = DONE;
    freed around = {0}, sent = {0};
    for (int is_over = 0; how == DONE && !is_over;) {
        const mesh_motion_region *region = NULL;
        const double *positions;
        answer corrected = {0};
        request made = {0};
        int result = mmv_region(session->volume, known, asked.metric, asked.below, asked.rings, around.count,
                                around.nodes, &region, &positions);
        how = result == MESH_MOTION_OK ? make_correct(session, what, &asked, region, positions, &made)
                                       : kernels_failed(session, result);
        how = how == DONE ? keep_sent(session, region, &sent) : how;
        mesh_motion_region_free(region);
        mmi_free_freed(&around);
        if (how == DONE) {
            int is_trial = strcmp(what, "trial") == 0;
            how = deliver_own(session, &made, is_trial ? is_corrected : is_never_kept, &corrected);
        } else {
            mmi_free_request(&made);
        }
        how = how == DONE ? read_corrected(session, &corrected, &around) : how;
        is_over = how == DONE && !read_extent(&corrected.reply.report, &asked);
        mmi_free_answer(&corrected);
    }
    if (how == DONE) {
        int64_t *nodes = malloc((around.count + 1) * sizeof *nodes);
        int result = nodes ? mmv_find(session->volume, around.count, around.nodes, nodes) : MESH_MOTION_OUT_OF_MEMORY;
        how = result == MESH_MOTION_OK ? DONE : mmi_no_memory(session->context);
        free(around.nodes);
        around.nodes = nodes;
        mmi_free_freed(found);
        *found = around;
        found->step = session->step + (strcmp(what, "trial") == 0);
        found->sent = sent.sent;
        found->sent_count = sent.sent_count;
        around = sent = (freed){0};
    }
    mmi_free_freed(&around);
    mmi_free_freed(&sent);
    return how;
}

/* Write the displacement of the freed nodes of this partition, added to base (nodes, dimension) if it is given. */
static void put_freed(const mm_session *session, const freed *found, const double *base, double *to)
{
    size_t d = (size_t)session->dimension;
    for (size_t i = 0; i < found->count; ++i) {
        for (size_t axis = 0; found->nodes[i] >= 0 && axis < d; ++axis) {
            size_t at = (size_t)found->nodes[i] * d + axis;
            to[at] = (base ? base[at] : 0.0) + found->displacement[i * d + axis];
        }
    }
}

outcome mmi_take_trial(mm_session *session, const answer *moved, double *to)
{
    char metric[32];
    double *known = NULL;
    extent region = {0};
    int is_bad = 0;
    session->trial_freed.step = session->step + 1;
    mm_report_text(&moved->reply.report, "quality.metric", metric, sizeof metric);
    outcome how = take_uploaded(session, moved, "displacement", &known);
    how = how == DONE ? evaluate(session, moved, known, to) : how;
    how = how == DONE ? judge_trial(session, metric, to, &region, &is_bad) : how;
    if (how == DONE && is_bad) {
        how = correct(session, "trial", known, region, &session->trial_freed);
        if (how == DONE) {
            put_freed(session, &session->trial_freed, NULL, to);
            how = judge_trial(session, metric, to, &region, &is_bad);
        }
    }
    free(known);
    return how;
}

outcome mmi_take_points(mm_session *session, const answer *fetched, double *points)
{
    size_t count, d = (size_t)session->dimension;
    const int64_t *nodes = mmv_uploaded(session->volume, &count);
    const double *at_rest = mmv_points(session->volume);
    double *known = NULL;
    extent region;
    outcome how = take_uploaded(session, fetched, "points", &known);
    how = how == DONE ? evaluate(session, fetched, known, points) : how;
    for (size_t i = 0; how == DONE && i < session->nodes * d; ++i) {
        points[i] += at_rest[i];
    }
    for (size_t row = 0; how == DONE && row < count; ++row) {
        memcpy(points + (size_t)nodes[row] * d, known + row * d, d * sizeof *points);
    }
    int is_known = session->committed_freed.step == session->step; /* else it was resumed */
    if (how == DONE && read_extent(&fetched->reply.report, &region)) {
        if (!is_known) {
            for (size_t row = 0; row < count * d; ++row) {
                known[row] -= at_rest[(size_t)nodes[row / d] * d + row % d];
            }
            how = correct(session, "committed", known, region, &session->committed_freed);
        }
        if (how == DONE) {
            put_freed(session, &session->committed_freed, at_rest, points);
        }
    } else if (how == DONE && !is_known) {
        mmi_free_freed(&session->committed_freed);
        session->committed_freed.step = session->step;
    }
    free(known);
    return how;
}

/* Find the nodes that were uploaded in addition to those of the boundary, and their order. */
static outcome know_uploaded(mm_session *session, const answer *fetched)
{
    const mmi_array *array = mmi_find_array(&fetched->reply, "nodes");
    size_t had;
    mmv_uploaded(session->volume, &had);
    if (!array || array->rows <= had) {
        return DONE;
    }
    size_t count = array->rows, here = 0;
    int64_t *ids = malloc(count * sizeof *ids), *nodes = malloc(count * sizeof *nodes);
    int result = ids && nodes ? MESH_MOTION_OK : MESH_MOTION_OUT_OF_MEMORY;
    if (result == MESH_MOTION_OK) {
        mmi_take_integers(ids, fetched, array);
        result = mmv_find(session->volume, count - had, ids + had, nodes);
    }
    for (size_t i = 0; result == MESH_MOTION_OK && i < count - had; ++i) {
        if (nodes[i] >= 0) { /* else the mesh is another one, and has too few rows */
            nodes[here++] = nodes[i];
        }
    }
    result = result == MESH_MOTION_OK ? mmv_extend(session->volume, here, nodes) : result;
    free(ids);
    free(nodes);
    return result == MESH_MOTION_OK ? DONE : kernels_failed(session, result);
}

outcome mmi_check_reference(mm_session *session)
{
    size_t count, d = (size_t)session->dimension;
    const int64_t *nodes;
    answer fetched = {0};
    double *rows = NULL;
    request fetch = mmi_session_request(session, "FETCH", "FETCHED");
    mmi_add_text(&fetch, "what", "reference");
    outcome how = mmi_deliver(session, &fetch, session->context->timeout, &fetched);
    how = how == DONE ? know_uploaded(session, &fetched) : how;
    how = how == DONE ? take_uploaded(session, &fetched, "points", &rows) : how;
    nodes = mmv_uploaded(session->volume, &count);
    for (size_t row = 0; how == DONE && row < count; ++row) {
        if (memcmp(rows + row * d, mmv_points(session->volume) + (size_t)nodes[row] * d, d * sizeof *rows) != 0) {
            how = mmi_fail(session->context, "INVALID_ARGUMENT",
                           "give the same points, cells and patches in the same order",
                           "the mesh is not the one that this session was opened with");
        }
    }
    free(rows);
    mmi_free_answer(&fetched);
    return how;
}

/* --- derivatives (SPEC.md, section 24) ---------------------------------------------------------------------------- */

void mmi_forget_correction(mm_session *session) { session->committed_freed.step = -1; }

outcome mmi_know_correction(mm_session *session)
{
    if (session->has_trial || (session->committed_freed.step == session->step && mmv_knows_field(session->volume))) {
        return DONE;
    }
    size_t nodes = session->nodes;
    double *points = malloc(nodes * (size_t)session->dimension * sizeof *points + 1);
    if (!points) {
        return mmi_no_memory(session->context);
    }
    answer fetched = {0};
    request fetch = mmi_session_request(session, "FETCH", "FETCHED");
    mmi_add_text(&fetch, "what", "committed");
    outcome how = mmi_deliver(session, &fetch, session->context->timeout, &fetched);
    how = how == DONE ? mmi_take_points(session, &fetched, points) : how;
    mmi_free_answer(&fetched);
    free(points);
    return how;
}

/* Copy rows of d numbers; the distances between rows are `from_step` and `to_step` numbers. */
static void copy_rows(double *to, size_t to_step, const double *from, size_t from_step, size_t rows, size_t d)
{
    for (size_t i = 0; i < rows; ++i) {
        memcpy(to + i * to_step, from + i * from_step, d * sizeof *to);
    }
}

outcome mmi_take_tangent(mm_session *session, size_t vectors, const answer *found, double *to)
{
    mm_context *context = session->context;
    mmv_volume *volume = session->volume;
    static const char *const NAMES[] = {"velocity", "coefficients", "freed_velocity"};
    const mmi_array *ids = mmi_find_array(&found->reply, "freed");
    size_t d = (size_t)session->dimension, columns = vectors * d, expected[] = {0, 0, ids ? ids->rows : 0};
    double *rows[3] = {0}, *one[3] = {0};
    outcome how = ids ? DONE : mmi_fail(context, "INTERNAL", "", "the server's field has no freed nodes");
    mmv_uploaded(volume, &expected[0]);
    expected[1] = mmv_coefficient_count(volume);
    for (int i = 0; how == DONE && i < 3; ++i) {
        const mmi_array *array = mmi_find_array(&found->reply, NAMES[i]);
        size_t count;
        if (!array || array->rows != expected[i] || array->columns != columns) {
            how = mmi_fail(context, "INTERNAL", "", "the server's %s must have shape (%zu, %zu), got (%zu, %zu)",
                           NAMES[i], expected[i], columns, array ? array->rows : 0, array ? array->columns : 0);
        } else {
            how = copy_array(context, found, NAMES[i], &rows[i], &count);
        }
        one[i] = how == DONE ? malloc(expected[i] * d * sizeof **one + 1) : NULL;
        how = how == DONE && !one[i] ? mmi_no_memory(context) : how;
    }
    double *velocity = malloc(session->nodes * d * sizeof *velocity + 1);
    int64_t *numbers = malloc((expected[2] + 1) * sizeof *numbers), *nodes = malloc((expected[2] + 1) * sizeof *nodes);
    if (how == DONE && (!velocity || !numbers || !nodes)) {
        how = mmi_no_memory(context);
    }
    if (how == DONE) {
        mmi_take_integers(numbers, found, ids);
        how = mmv_find(volume, expected[2], numbers, nodes) == MESH_MOTION_OK ? DONE : mmi_no_memory(context);
    }
    for (size_t first = 0; how == DONE && first < columns; first += d) {
        for (int i = 0; i < 3; ++i) {
            copy_rows(one[i], d, rows[i] + first, columns, expected[i], d);
        }
        int result = mmv_velocity(volume, one[1], one[0], velocity);
        how = result == MESH_MOTION_OK ? DONE : kernels_failed(session, result);
        for (size_t i = 0; how == DONE && i < expected[2]; ++i) {
            if (nodes[i] >= 0) {
                memcpy(velocity + (size_t)nodes[i] * d, one[2] + i * d, d * sizeof *velocity);
            }
        }
        if (how == DONE) {
            copy_rows(to + first, columns, velocity, d, session->nodes, d);
        }
    }
    for (int i = 0; i < 3; ++i) {
        free(rows[i]);
        free(one[i]);
    }
    free(velocity);
    free(numbers);
    free(nodes);
    return how;
}

outcome mmi_add_weights(mm_session *session, size_t vectors, const double *weights, request *to)
{
    mm_context *context = session->context;
    mmv_volume *volume = session->volume;
    const freed *state = session->has_trial ? &session->trial_freed : &session->committed_freed;
    size_t d = (size_t)session->dimension, columns = vectors * d, count, rows = mmv_coefficient_count(volume);
    const int64_t *uploaded = mmv_uploaded(volume, &count);
    double *of_boundary = own_array(to, 0, "weights", count, columns, sizeof *of_boundary);
    double *counts = own_array(to, 1, "coefficients", rows, columns, sizeof *counts);
    int64_t *ids = own_array(to, 2, "region", state->sent_count, 1, sizeof *ids);
    double *of_region = own_array(to, 3, "region_weights", state->sent_count, columns, sizeof *of_region);
    double *others = malloc(session->nodes * d * sizeof *others + 1), *found = malloc(rows * d * sizeof *found + 1);
    outcome how = of_boundary && counts && ids && of_region && others && found ? DONE : mmi_no_memory(context);
    to->arrays[0].is_float = to->arrays[1].is_float = to->arrays[3].is_float = to->arrays[2].is_list = 1;
    for (size_t i = 0; how == DONE && i < count; ++i) {
        memcpy(of_boundary + i * columns, weights + (size_t)uploaded[i] * columns, columns * sizeof *weights);
    }
    for (size_t i = 0; how == DONE && i < state->sent_count; ++i) {
        ids[i] = mmv_id_of(volume, state->sent[i]);
        memcpy(of_region + i * columns, weights + (size_t)state->sent[i] * columns, columns * sizeof *weights);
    }
    for (size_t first = 0; how == DONE && first < columns; first += d) {
        copy_rows(others, d, weights + first, columns, session->nodes, d);
        for (size_t i = 0; i < count; ++i) {
            memset(others + (size_t)uploaded[i] * d, 0, d * sizeof *others);
        }
        for (size_t i = 0; i < state->sent_count; ++i) {
            memset(others + (size_t)state->sent[i] * d, 0, d * sizeof *others);
        }
        int result = mmv_counts(volume, others, found);
        how = result == MESH_MOTION_OK ? DONE : kernels_failed(session, result);
        copy_rows(counts + first, columns, found, d, rows, d);
    }
    free(others);
    free(found);
    return how;
}

int mmi_knows_field(const mm_session *session) { return session->evaluates && mmv_knows_field(session->volume); }

int64_t mmi_in_mesh(const mm_session *session, int64_t node)
{
    size_t count;
    const int64_t *nodes = mmv_uploaded(session->volume, &count);
    return node >= 0 && (uint64_t)node < count ? nodes[node] : -1;
}

#else

static outcome not_built_in(const mm_session *session)
{
    return mmi_fail(session->context, "UNIMPLEMENTED", "build it with the compiled kernels",
                    "this client was built without evaluation by the client");
}
outcome mmi_make_volume(mm_session *session) { return session->evaluates ? not_built_in(session) : DONE; }
outcome mmi_gather_blocks(mm_session *session) { return not_built_in(session); }
outcome mmi_add_near_cells(mm_session *session, const answer *built)
{
    (void)built;
    return not_built_in(session);
}
outcome mmi_check_reference(mm_session *session) { return not_built_in(session); }
outcome mmi_take_trial(mm_session *session, const answer *moved, double *to)
{
    (void)moved, (void)to;
    return not_built_in(session);
}
outcome mmi_take_points(mm_session *session, const answer *fetched, double *points)
{
    (void)fetched, (void)points;
    return not_built_in(session);
}
int64_t mmi_in_mesh(const mm_session *session, int64_t node)
{
    (void)session;
    return node;
}
int mmi_knows_field(const mm_session *session)
{
    (void)session;
    return 0;
}
void mmi_forget_correction(mm_session *session) { (void)session; }
outcome mmi_know_correction(mm_session *session) { return not_built_in(session); }
outcome mmi_take_tangent(mm_session *session, size_t vectors, const answer *found, double *to)
{
    (void)vectors, (void)found, (void)to;
    return not_built_in(session);
}
outcome mmi_add_weights(mm_session *session, size_t vectors, const double *weights, request *to)
{
    (void)vectors, (void)weights, (void)to;
    return not_built_in(session);
}
void mmi_keep_freed(mm_session *session) { (void)session; }

#endif
