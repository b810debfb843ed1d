/* Requests that the server executes once, although connections break and workers die.
 *
 * In this order:
 * - requests: numbered, packed, sent, and repeated with the same id (SPEC.md, section 10);
 * - replies: received, compared with the request, read;
 * - the control endpoint: HELLO, OPEN, RESUME, PROBE, repeated until the server answers;
 * - the data endpoint: delivery over broken connections and to restarted workers (SPEC.md, section 11).
 */
#define _POSIX_C_SOURCE 200809L

#include "mm_session.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <zmq.h>

#define ATTEMPTS 5            /* one request is sent over at most this number of connections */
#define WATCH_SECONDS 1.0     /* after this time without a message the client sends PROBE */
#define SILENT_SECONDS 1.5    /* after this time without any answer a warning is given … */
#define STARTING_SECONDS 10.0 /* … or after this time if a worker has to start */
#define UNKNOWN_NODES ((size_t)1 << 31)

/* --- requests ----------------------------------------------------------------------------------------------------- */

outcome mmi_new_line(mm_context *context, line *line)
{
    int file = open("/dev/urandom", O_RDONLY | O_CLOEXEC);
    ssize_t count = file < 0 ? -1 : read(file, line->client, sizeof line->client);
    if (file >= 0) {
        close(file);
    }
    if (count != (ssize_t)sizeof line->client) {
        return mmi_fail(context, "INTERNAL", "", "/dev/urandom gives no random numbers");
    }
    line->client[6] = (uint8_t)((line->client[6] & 0x0f) | 0x40);
    line->client[8] = (uint8_t)((line->client[8] & 0x3f) | 0x80);
    return DONE;
}

request mmi_new_request(const char *type, const char *reply)
{
    request made = {0};
    made.type = type;
    made.reply = reply;
    made.epoch = -1;
    return made;
}

void mmi_add_text(request *request, const char *key, const char *value)
{
    ++request->field_count;
    mmi_put_text(&request->fields, key);
    mmi_put_text(&request->fields, value);
}

void mmi_add_integer(request *request, const char *key, int64_t value)
{
    ++request->field_count;
    mmi_put_text(&request->fields, key);
    mmi_put_integer(&request->fields, value);
}

void mmi_add_number(request *request, const char *key, double value)
{
    ++request->field_count;
    mmi_put_text(&request->fields, key);
    mmi_put_number(&request->fields, value);
}

void mmi_add_flag(request *request, const char *key, int value)
{
    ++request->field_count;
    mmi_put_text(&request->fields, key);
    mmi_put_flag(&request->fields, value);
}

static void add_bytes(request *request, const char *key, const uint8_t *value, size_t size)
{
    ++request->field_count;
    mmi_put_text(&request->fields, key);
    mmi_put_bytes(&request->fields, value, size);
}

block mmi_make_block(const char *item, const void *data, size_t rows, size_t columns, size_t width)
{
    block made = {0};
    made.item = item;
    made.data = data;
    made.rows = rows;
    made.columns = columns;
    made.width = width;
    return made;
}

void mmi_free_request(request *own)
{
    mmi_writer_free(&own->fields);
    for (int i = 0; i < MOST_ARRAYS; ++i) {
        free(own->arrays[i].owned);
    }
    *own = (request){0};
}

size_t mmi_array_bytes(const block *array) { return array->item ? array->rows * array->columns * array->width : 0; }

static uint64_t hashed(uint64_t hash, const void *data, size_t size)
{
    const uint8_t *bytes = data;
    for (size_t i = 0; i < size; ++i) {
        hash = (hash ^ bytes[i]) * UINT64_C(1099511628211);
    }
    return hash;
}

/* FNV-1a over all parts of a request: the caller may have changed the arrays since the last attempt. */
static uint64_t content_of(const request *request)
{
    uint64_t hash = UINT64_C(14695981039346656037);
    hash = hashed(hash, request->type, strlen(request->type));
    hash = hashed(hash, request->fields.data, request->fields.size);
    for (const block *array = request->arrays; array < request->arrays + MOST_ARRAYS && array->item; ++array) {
        size_t shape[2] = {array->rows, array->columns};
        hash = hashed(hash, shape, sizeof shape);
        hash = hashed(hash, array->data, mmi_array_bytes(array));
    }
    return hash;
}

/* Whether the server keeps the reply (SPEC 10.7). Other requests get a new number each time, since a late reply would
 * have the old state. */
static int is_kept(const request *request)
{
    static const char *const KEPT[] = {"OPEN",  "RESUME",  "UPLOAD", "BUILD",   "MOVE",
                                       "JUDGE", "CORRECT", "COMMIT", "ROLLBACK"};
    for (size_t i = 0; i < sizeof KEPT / sizeof *KEPT; ++i) {
        if (strcmp(request->type, KEPT[i]) == 0) {
            return 1;
        }
    }
    return 0;
}

/* The next number. A repeat of a request that was given up unanswered keeps its number, so it is executed once. */
static void number(line *line, unanswered *before, request *request)
{
    request->client = line->client;
    if (is_kept(request) && before->number && before->content == content_of(request)) {
        request->sequence = before->number;
    } else {
        request->sequence = ++line->sequence;
    }
    if (is_kept(request)) {
        before->number = 0;
    }
}

int mmi_is_unknown(const mm_context *context)
{
    return context->error == MM_DEADLINE_EXCEEDED || context->error == MM_UNAVAILABLE || context->error == MM_INTERNAL;
}

/* Keep the request, so that the caller may repeat the call. */
static void remember_unanswered(mm_context *context, unanswered *kept, const request *request)
{
    if (is_kept(request) && (mmi_is_unknown(context) || mm_error_is(context, "RESOURCE_EXHAUSTED.MEMORY"))) {
        kept->number = request->sequence;
        kept->content = content_of(request);
    }
}

static void pack_header(mmi_writer *out, const request *request)
{
    mmi_put_map(out, 6);
    mmi_put_text(out, "v");
    mmi_put_integer(out, 1);
    mmi_put_text(out, "type");
    mmi_put_text(out, request->type);
    mmi_put_text(out, "client");
    mmi_put_bytes(out, request->client, MMI_CLIENT_BYTES);
    mmi_put_text(out, "sequence");
    mmi_put_integer(out, request->sequence);
    mmi_put_text(out, "fields");
    mmi_put_map(out, request->field_count + (request->epoch >= 0));
    if (request->epoch >= 0) {
        mmi_put_text(out, "epoch");
        mmi_put_integer(out, request->epoch);
    }
    mmi_put_raw(out, request->fields.data, request->fields.size);
    mmi_put_text(out, "arrays");
    size_t count = 0;
    while (count < MOST_ARRAYS && request->arrays[count].item) {
        ++count;
    }
    mmi_put_array(out, count);
    for (const block *array = request->arrays; array < request->arrays + count; ++array) {
        char dtype[4] = {'<', array->is_float ? 'f' : 'i', array->width == 8 ? '8' : '4', '\0'};
        mmi_put_map(out, 3);
        mmi_put_text(out, "name");
        mmi_put_text(out, array->item);
        mmi_put_text(out, "dtype");
        mmi_put_text(out, dtype);
        mmi_put_text(out, "shape");
        mmi_put_array(out, array->is_list ? 1 : 2);
        mmi_put_integer(out, (int64_t)array->rows);
        if (!array->is_list) {
            mmi_put_integer(out, (int64_t)array->columns);
        }
    }
}

static outcome send_request(mm_context *context, connection *connection, const request *request)
{
    mmi_writer header = {0};
    size_t left = 0; /* of all arrays */
    for (int i = 0; i < MOST_ARRAYS; ++i) {
        left += mmi_array_bytes(&request->arrays[i]);
    }
    pack_header(&header, request);
    if (header.failed || request->fields.failed) {
        mmi_writer_free(&header);
        if (request->fields.no_utf8[0]) {
            return mmi_fail(context, "INVALID_ARGUMENT", "names, labels and settings are texts in UTF-8",
                            "%s has a text that is not UTF-8: '%s'", request->type, request->fields.no_utf8);
        }
        return mmi_fail(context, "RESOURCE_EXHAUSTED.BYTES", "", "the header of %s has more than %u bytes",
                        request->type, MMI_HEADER_BYTES);
    }
    int sent = mmi_send_frame(connection, header.data, header.size, left > 0);
    mmi_writer_free(&header);
    for (int i = 0; i < MOST_ARRAYS; ++i) {
        const uint8_t *bytes = request->arrays[i].data;
        size_t of_array = mmi_array_bytes(&request->arrays[i]);
        while (sent == 0 && of_array) {
            size_t chunk = of_array < MMI_CHUNK_BYTES ? of_array : MMI_CHUNK_BYTES;
            of_array -= chunk;
            left -= chunk;
            sent = mmi_send_frame(connection, bytes, chunk, left > 0);
            bytes += chunk;
        }
    }
    if (sent != 0) {
        /* the queue of libzmq is full, since the other side does not read */
        mmi_disconnect(connection);
        return mmi_lost(context, "%s takes no more requests", connection->endpoint);
    }
    return DONE;
}

/* --- replies ------------------------------------------------------------------------------------------------------ */

/* Set the error that the server sent; its details keep the reply's memory. */
static outcome fail_as(mm_context *context, answer *from)
{
    mm_report *report = &from->reply.report;
    char code[sizeof context->problem.code], message[sizeof context->problem.message],
        hint[sizeof context->problem.hint];
    mmi_copy_text(report, mmi_find(report, report->root, "code", 4), code, sizeof code);
    mmi_copy_text(report, mmi_find(report, report->root, "message", 7), message, sizeof message);
    mmi_copy_text(report, mmi_find(report, report->root, "hint", 4), hint, sizeof hint);
    mmi_fail(context, code, hint, "%s", message);
    report->root = mmi_find(report, report->root, "details", 7);
    context->problem.details = *report;
    *report = (mm_report){0};
    return FAILED;
}

void mmi_free_answer(answer *from)
{
    for (size_t i = 0; i < from->count; ++i) {
        zmq_msg_close(&from->frames[i]);
    }
    free(from->frames);
    free(from->sizes);
    mmi_report_free(&from->reply.report);
    *from = (answer){0};
}

/* Room for all frames at once: a realloc would move libzmq's messages, which is not allowed. */
static int make_room(answer *to, size_t frames)
{
    to->frames = malloc(frames * sizeof *to->frames);
    to->sizes = malloc(frames * sizeof *to->sizes);
    to->capacity = frames;
    return to->frames && to->sizes;
}

/* The most frames of a reply to this session: frame 0, and arrays with at most three numbers a node. The mesh is
 * assumed to be large before JOINED gives its size, and if the reply may carry a field. */
static size_t most_frames(const mm_session *session)
{
    size_t nodes = session ? session->nodes && !session->evaluates ? session->nodes : UNKNOWN_NODES : 0;
    return 1 + MMI_MOST_ARRAYS * ((nodes * 3 * sizeof(double) + MMI_CHUNK_BYTES - 1) / MMI_CHUNK_BYTES);
}

/* The frames are not a message. What follows on this connection cannot be trusted either. */
static outcome damaged(mm_context *context, connection *connection, const char *wrong)
{
    mmi_disconnect(connection);
    return mmi_fail(context, "INTERNAL", "repeat the call: the server executes it only once",
                    "the server's reply is not a message: %s", wrong);
}

/* Take all frames of the next message. ZeroMQ delivers whole messages only. */
static outcome receive(mm_context *context, connection *connection, const mm_session *session, answer *to)
{
    int more = 1;
    mmi_free_answer(to);
    if (!make_room(to, most_frames(session))) {
        mmi_disconnect(connection); /* the message is dropped with it */
        return mmi_no_memory(context);
    }
    while (more) {
        if (to->count == to->capacity) {
            return damaged(context, connection, "it has more frames than the mesh can fill");
        }
        zmq_msg_t *frame = &to->frames[to->count];
        zmq_msg_init(frame);
        int size = zmq_msg_recv(frame, connection->socket, ZMQ_DONTWAIT);
        if (size < 0) {
            zmq_msg_close(frame);
            if (zmq_errno() == EINTR) {
                continue;
            }
            return mmi_lost(context, "the connection to %s ended", connection->endpoint);
        }
        to->sizes[to->count++] = (size_t)size;
        more = zmq_msg_more(frame);
    }
    const uint8_t *header = zmq_msg_data(&to->frames[0]);
    const char *wrong = mmi_read_header(&to->reply, header, to->sizes[0]);
    return wrong ? damaged(context, connection, wrong) : DONE;
}

static outcome watch(mm_session *session, double deadline);

/* Warn once that no server answers, since the call may wait for half an hour. */
static void warn_of_silence(mm_context *context, const request *request)
{
    int starts = strcmp(request->type, "OPEN") == 0 || strcmp(request->type, "RESUME") == 0;
    if (context->is_silent || mmi_now() - context->asked_at < (starts ? STARTING_SECONDS : SILENT_SECONDS)) {
        return;
    }
    context->is_silent = 1;
    char line[ENDPOINT_BYTES + 128];
    snprintf(line, sizeof line, "%s%s at %s; asking for %.0f s", starts ? request->type : "no server answers",
             starts ? " is not answered" : "", context->endpoint, mmi_seconds_left(context->waits_until));
    if (context->warning) {
        context->warning(context->warned, line);
    }
}

/* Wait for a message. `watched` is the session whose worker may die although the connection stays. */
static outcome wait_for_message(mm_context *context, connection *connection, const request *request, double deadline,
                                mm_session *watched)
{
    while (!mmi_is_readable(connection->socket)) {
        double left = mmi_seconds_left(deadline);
        zmq_pollitem_t items[2] = {{connection->socket, 0, ZMQ_POLLIN, 0}, {connection->events, 0, ZMQ_POLLIN, 0}};
        zmq_poll(items, 2, (long)ceil(1000.0 * (left < WATCH_SECONDS ? left : WATCH_SECONDS)));
        if (mmi_is_readable(connection->socket)) {
            break;
        }
        if (connection == &context->control) {
            warn_of_silence(context, request);
        }
        outcome how = mmi_check_connected(context, connection);
        if (how == DONE && mmi_seconds_left(deadline) == 0.0) {
            mmi_disconnect(connection); /* the connection may be dead without an event */
            how = mmi_fail(context, "DEADLINE_EXCEEDED", "repeat the call: the server executes it only once",
                           "no answer to %s from %s within the time allowed", request->type, connection->endpoint);
        }
        if (how == DONE && watched) {
            how = watch(watched, deadline);
        }
        if (how != DONE) {
            return how;
        }
    }
    return DONE;
}

/* Check the reply to this request, and set its error, if any. */
static outcome judge(mm_context *context, connection *connection, const request *request, answer *got)
{
    const char *wrong = mmi_read_body(&got->reply, got->sizes, got->count);
    if (wrong) {
        return damaged(context, connection, wrong);
    }
    if (strcmp(got->reply.type, "ERROR") == 0) {
        return fail_as(context, got);
    }
    if (strcmp(got->reply.type, request->reply) != 0) {
        return mmi_fail(context, "INTERNAL", "", "the reply to %s must be %s, got %s", request->type, request->reply,
                        got->reply.type);
    }
    return DONE;
}

static outcome await_reply(mm_context *context, connection *connection, const request *request, double deadline,
                           mm_session *watched, answer *got)
{
    for (;;) {
        outcome how = wait_for_message(context, connection, request, deadline, watched);
        if (how == DONE) {
            how = receive(context, connection, watched, got);
        }
        if (how != DONE) {
            return how;
        }
        /* skip late replies to earlier requests */
        if (got->reply.sequence == request->sequence
            && memcmp(got->reply.client, request->client, MMI_CLIENT_BYTES) == 0) {
            return judge(context, connection, request, got);
        }
    }
}

static outcome exchange(mm_context *context, connection *connection, const request *request, double deadline,
                        mm_session *watched, answer *got)
{
    outcome how = mmi_check_connected(context, connection);
    if (how == DONE) {
        how = send_request(context, connection, request);
    }
    if (how == DONE) {
        how = await_reply(context, connection, request, deadline, watched, got);
    }
    mmi_take_back_arrays(connection);
    return how;
}

uint32_t mmi_field(const answer *from, const char *name)
{
    return mmi_find(&from->reply.report, from->reply.report.root, name, strlen(name));
}

int64_t mmi_integer_field(const answer *from, const char *name)
{
    return mm_report_integer(&from->reply.report, name, 0);
}

void mmi_keep_report(mm_report *to, answer *from)
{
    mmi_report_free(to);
    *to = from->reply.report;
    from->reply.report = (mm_report){0};
}

void mmi_take_numbers(double *to, const answer *from, const mmi_array *array)
{
    for (size_t i = array->first_frame; i < array->first_frame + array->frames; ++i) {
        size_t count = from->sizes[i] / array->width;
        mmi_copy_numbers(to, zmq_msg_data(&from->frames[i]), count, array->width);
        to += count;
    }
}

void mmi_take_integers(int64_t *to, const answer *from, const mmi_array *array)
{
    for (size_t i = array->first_frame; i < array->first_frame + array->frames; ++i) {
        size_t count = from->sizes[i] / array->width;
        mmi_copy_integers(to, zmq_msg_data(&from->frames[i]), count, array->width);
        to += count;
    }
}

/* --- the control endpoint ----------------------------------------------------------------------------------------- */

outcome mmi_ask(mm_context *context, unanswered *opening, request *request, double seconds, answer *got)
{
    double deadline = mmi_now() + seconds;
    outcome how;
    context->asked_at = mmi_now();
    context->waits_until = fmax(context->waits_until, deadline);
    number(&context->line, opening, request);
    for (;;) {
        how = context->control.socket ? DONE : mmi_connect_to(context, &context->control, context->endpoint);
        if (how == DONE) {
            how = exchange(context, &context->control, request, deadline, NULL, got);
        }
        if (how == LOST) {
            mmi_disconnect(&context->control);
        }
        if (how == DONE || context->error != MM_UNAVAILABLE || mmi_seconds_left(deadline) <= PAUSE_SECONDS) {
            break;
        }
        mm_clear_error(context);
        mmi_pause_for(PAUSE_SECONDS);
    }
    context->is_silent = context->is_silent && mmi_is_unknown(context);
    remember_unanswered(context, opening, request);
    mmi_writer_free(&request->fields);
    return how;
}

static request request_about(const mm_session *session, const char *type, const char *reply)
{
    request about = mmi_new_request(type, reply);
    mmi_add_text(&about, "session", session->id);
    add_bytes(&about, "token", session->token, MM_TOKEN_BYTES);
    return about;
}

outcome mmi_probe(mm_session *session, double seconds, answer *got)
{
    request about = request_about(session, "PROBE", "PROBED");
    return mmi_ask(session->context, NULL, &about, seconds, got);
}

outcome mmi_resume(mm_session *session, double seconds, answer *got)
{
    request about = request_about(session, "RESUME", "RESUMED");
    return mmi_ask(session->context, &session->opening, &about, seconds, got);
}

/* A RESUME of this client was not answered: then a higher epoch does not mean that another client has the session. */
static int is_resuming(const mm_session *session)
{
    request about = request_about(session, "RESUME", "RESUMED");
    int is = session->opening.number && session->opening.content == content_of(&about);
    mmi_writer_free(&about.fields);
    return is;
}

void mmi_data_endpoint(const mm_context *context, const answer *from, char *to, size_t size)
{
    static const char *const ANYWHERE[] = {"tcp://0.0.0.0:", "tcp://[::]:", "tcp://*:"};
    char given[ENDPOINT_BYTES];
    const char *port = strrchr(context->endpoint, ':');
    mm_report_text(&from->reply.report, "endpoint", given, sizeof given);
    snprintf(to, size, "%s", given);
    for (size_t i = 0; i < sizeof ANYWHERE / sizeof *ANYWHERE; ++i) {
        size_t prefix = strlen(ANYWHERE[i]);
        if (strncmp(given, ANYWHERE[i], prefix) == 0 && port) {
            snprintf(to, size, "%.*s:%s", (int)(port - context->endpoint), context->endpoint, given + prefix);
        }
    }
}

/* --- the data endpoint -------------------------------------------------------------------------------------------- */

request mmi_session_request(const mm_session *session, const char *type, const char *reply)
{
    request made = mmi_new_request(type, reply);
    made.epoch = session->epoch;
    mmi_add_text(&made, "session", session->id);
    mmi_add_integer(&made, "partition", session->partition);
    return made;
}

outcome mmi_join_worker(mm_session *session, const char *endpoint, int64_t epoch, double seconds, answer *got)
{
    mm_context *context = session->context;
    outcome how = mmi_connect_to(context, &session->data, endpoint);
    if (how != DONE) {
        return how;
    }
    session->epoch = epoch;
    request join = mmi_session_request(session, "JOIN", "JOINED");
    add_bytes(&join, "token", session->token, MM_TOKEN_BYTES);
    join.client = session->line.client;
    join.sequence = ++session->line.sequence;
    how = exchange(context, &session->data, &join, mmi_now() + seconds, session, got);
    mmi_writer_free(&join.fields);
    if (how != DONE) {
        mmi_disconnect(&session->data); /* the first request of a connection must be JOIN */
    }
    return how;
}

static outcome check_unfenced(mm_session *session, const answer *probed)
{
    if (mmi_integer_field(probed, "epoch") <= session->epoch) {
        return DONE;
    }
    return mmi_fail(session->context, "ABORTED.FENCED", "discard this session, or resume it again from here",
                    "the session was resumed by another holder (epoch %" PRId64 ")",
                    mmi_integer_field(probed, "epoch"));
}

/* While a request is computed: LOST if the worker has died, FAILED if another client has resumed the session. */
static outcome watch(mm_session *session, double deadline)
{
    mm_context *context = session->context;
    answer probed = {0};
    double left = mmi_seconds_left(deadline);
    outcome how = mmi_probe(session, left < PROBE_SECONDS ? left : PROBE_SECONDS, &probed);
    if (how == DONE) {
        const mm_report *report = &probed.reply.report;
        uint32_t worker = mmi_field(&probed, "worker");
        if (mmi_is_text(report, worker, "dead") || mmi_is_text(report, worker, "none")) {
            how = mmi_lost(context, "the worker of session %s is gone", session->id);
        } else {
            how = check_unfenced(session, &probed);
        }
    } else if (context->error == MM_DEADLINE_EXCEEDED || context->error == MM_UNAVAILABLE) {
        mm_clear_error(context);
        how = DONE;
    }
    mmi_free_answer(&probed);
    return how;
}

/* Ask PROBE until the worker has started; `worker` is its state. */
static outcome probe_started(mm_session *session, double deadline, char *worker, size_t size, answer *got)
{
    for (;;) {
        outcome how = mmi_probe(session, mmi_seconds_left(deadline), got);
        if (how != DONE) {
            return how;
        }
        mm_report_text(&got->reply.report, "worker", worker, size);
        if (strcmp(worker, "starting") != 0) {
            return DONE;
        }
        if (mmi_seconds_left(deadline) == 0.0) {
            return mmi_fail(session->context, "UNAVAILABLE.STARTING", "try again",
                            "the session's worker is still starting");
        }
        mmi_pause_for(PAUSE_SECONDS / 2);
    }
}

/* Find the session's worker (SPEC 11.1): the same one, or another one that has resumed it from the journal. */
static outcome find_worker(mm_session *session, double deadline, answer *got)
{
    char worker[16] = "";
    if (is_resuming(session)) {
        return mmi_resume(session, mmi_seconds_left(deadline), got);
    }
    outcome how = probe_started(session, deadline, worker, sizeof worker, got);
    if (how != DONE) {
        return how;
    }
    if (strcmp(worker, "alive") == 0) {
        return check_unfenced(session, got);
    }
    if (session->may_resume) {
        return mmi_resume(session, mmi_seconds_left(deadline), got);
    }
    return mmi_fail(
        session->context, "UNAVAILABLE.WORKER",
        "resume the session from one partition and join it from the others; "
        "a session that was never built must be opened again",
        "the session's worker is %s", worker);
}

outcome mmi_take_step(mm_session *session, int64_t step)
{
    mm_context *context = session->context;
    int64_t known = session->step;
    session->step = step;
    if (step >= known) {
        return DONE;
    }
    mmi_writer details = {0};
    session->iteration = session->has_trial = 0;
    session->request.number = 0;
    mmi_fail(context, "ABORTED.STEPS_LOST",
             "continue from mm_step: the same moves and commits give the same coordinates again",
             "step %" PRId64 " was committed, but after a restart the session stands at step %" PRId64, known, step);
    mmi_put_map(&details, 1);
    mmi_put_text(&details, "details");
    mmi_put_map(&details, 2);
    mmi_put_text(&details, "expected");
    mmi_put_integer(&details, step + 1);
    mmi_put_text(&details, "got");
    mmi_put_integer(&details, known + 1);
    if (!details.failed && !mmi_parse(&context->problem.details, details.data, details.size)) {
        context->problem.details.root = mmi_find(&context->problem.details, 0, "details", 7);
    }
    mmi_writer_free(&details);
    return FAILED;
}

static outcome recover(mm_session *session, double deadline)
{
    char endpoint[ENDPOINT_BYTES];
    answer found = {0}, joined = {0};
    outcome how = find_worker(session, deadline, &found);
    if (how == DONE) {
        mmi_data_endpoint(session->context, &found, endpoint, sizeof endpoint);
        how =
            mmi_join_worker(session, endpoint, mmi_integer_field(&found, "epoch"), mmi_seconds_left(deadline), &joined);
    }
    if (how == DONE && mmi_integer_field(&joined, "step") < session->step) {
        how = mmi_take_step(session, mmi_integer_field(&joined, "step"));
    }
    mmi_free_answer(&found);
    mmi_free_answer(&joined);
    return how;
}

/* Send a request once, with the current epoch, over a new connection if the old one has ended. */
static outcome request_data(mm_session *session, request *request, double deadline, answer *got)
{
    outcome how = session->data.socket ? DONE : recover(session, deadline);
    if (how == DONE) {
        request->epoch = session->epoch;
        how = exchange(session->context, &session->data, request, deadline, session, got);
    }
    if (how == LOST) {
        mmi_disconnect(&session->data);
    }
    return how;
}

/* Times, velocities, swept faces and the headroom. */
static void add_velocity(request *move, const mm_session *session)
{
    if (session->has_time) {
        mmi_add_number(move, "time", session->time);
    }
    if (session->scheme[0]) {
        mmi_add_text(move, "velocity", session->scheme);
    }
    int is_headroom = strcmp(session->report, "headroom") == 0 || strcmp(session->report, "faces") == 0;
    if (is_headroom && session->headroom_along[0]) {
        mmi_add_text(move, "headroom_along", session->headroom_along);
    }
    block *array = &move->arrays[1]; /* behind the displacement */
    if (session->boundary_velocity && strcmp(session->scheme, "tangent") == 0) {
        *array = mmi_make_block("boundary_velocity", session->boundary_velocity, session->moving_count,
                                (size_t)session->dimension, 8);
        array->is_float = 1;
        ++array;
    }
    if (session->swept_faces && strcmp(session->report, "swept") == 0) {
        *array = mmi_make_block("swept_faces", session->swept_faces, session->face_count, session->face_corners, 8);
    }
}

request mmi_move_request(const mm_session *session, mm_frame frame, const double *rows)
{
    request move = mmi_session_request(session, "MOVE", "MOVED");
    mmi_add_integer(&move, "step", session->step + 1);
    mmi_add_text(&move, "frame", frame == MM_SINCE_REFERENCE ? "reference" : "committed");
    mmi_add_text(&move, "report", session->report);
    move.arrays[0] = mmi_make_block("displacement", rows, session->moving_count, (size_t)session->dimension, 8);
    move.arrays[0].is_float = 1;
    add_velocity(&move, session);
    return move;
}

/* Repeat the MOVE of a lost trial: its reply depends on the committed state only (SPEC 7.1, 11.4). */
static outcome repeat_trial(mm_session *session, double deadline)
{
    answer moved = {0};
    request move = mmi_move_request(session, session->trial_frame, session->trial);
    mm_clear_error(session->context);
    move.client = session->line.client;
    move.sequence = ++session->line.sequence;
    outcome how = request_data(session, &move, deadline, &moved);
    mmi_writer_free(&move.fields);
    mmi_free_answer(&moved);
    for (size_t i = 0; how == DONE && i < session->accepted_count; ++i) {
        session->accepted[i].client = session->line.client;
        session->accepted[i].sequence = ++session->line.sequence;
        how = request_data(session, &session->accepted[i], deadline, &moved);
        mmi_free_answer(&moved);
    }
    return how;
}

outcome mmi_deliver(mm_session *session, request *request, double seconds, answer *got)
{
    mm_context *context = session->context;
    double deadline = mmi_now() + seconds;
    outcome how = LOST;
    context->waits_until = deadline;
    number(&session->line, &session->request, request);
    for (int attempt = 0; attempt < ATTEMPTS && how == LOST; ++attempt) {
        if (attempt > 1) { /* a server may need a moment to see that its worker has died */
            mmi_pause_for(fmin((1 << (attempt - 1)) * PAUSE_SECONDS, mmi_seconds_left(deadline)));
        }
        mm_clear_error(context);
        how = request_data(session, request, deadline, got);
        if (how == FAILED && session->has_trial && mm_error_is(context, "ABORTED.TRIAL_LOST")) {
            how = repeat_trial(session, deadline);
            how = how == DONE ? LOST : how; /* and now the request again */
        }
    }
    context->waits_until = 0.0;
    if (how == LOST) {
        mmi_fail(context, "UNAVAILABLE", "", "%s broke %d connections to %s", request->type, ATTEMPTS,
                 session->data.endpoint);
    }
    remember_unanswered(context, &session->request, request);
    mmi_writer_free(&request->fields);
    return how;
}

outcome mmi_check_joined(mm_session *session)
{
    return session->joined ? DONE
                           : mmi_fail(session->context, "FAILED_PRECONDITION.STATE",
                                      "mm_open, mm_join or mm_resume first", "the session is not open");
}
