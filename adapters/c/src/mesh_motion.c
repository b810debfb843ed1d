/* The client: connections, requests that are done once whatever breaks, and the verbs. See mesh_motion.h.
 *
 * In this order:
 * - errors: one place in the context;
 * - connections: a DEALER socket and its monitor. ZeroMQ mends broken connections in silence, and what was under way
 *   is lost without a word; so the end of a connection is watched for;
 * - requests: numbered, sent, repeated by the same id (SPEC.md, section 10);
 * - control: HELLO, OPEN, RESUME, PROBE, asked until they are answered;
 * - data: delivered over broken connections and died workers (SPEC.md, section 11);
 * - verbs: what the public header has.
 */
#define _POSIX_C_SOURCE 200809L

#include "mesh_motion.h"

#include "mm_wire.h"

#ifdef MM_EVALUATION
#include "mm_volume.h"
#endif

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <math.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>
#include <zmq.h>

#define AGENT "mesh_motion_c " MM_VERSION
#define KEY_CHARACTERS 40
#define NAME_BYTES 257     /* what SPEC.md admits for names and labels, and the end */
#define ENDPOINT_BYTES 512 /* a path of ipc:// is at most 107, a host name 253 */

/* One request survives so many broken connections. */
#define ATTEMPTS 5
/* A worker that falls while the mesh is uploaded leaves nothing to resume: the session is opened again so often. */
#define OPEN_ATTEMPTS 3
#define WATCH_SECONDS 1.0             /* silence after which PROBE is asked */
#define PROBE_SECONDS 2.0             /* for a PROBE meanwhile; silence of the control endpoint alone ends nothing */
#define SILENT_SECONDS 1.5            /* after so long without any answer a warning says so … */
#define STARTING_SECONDS 10.0         /* … where a worker has to start: after so long */
#define PAUSE_SECONDS 0.2             /* between two tries while nobody can answer */
#define START_SECONDS 300.0           /* a server's first session waits until a worker has started */
#define PART_BYTES ((size_t)32 << 20) /* of one UPLOAD: the worker never holds much beside the mesh itself */
#define UNKNOWN_NODES ((size_t)1 << 31)
/* Smaller arrays are copied: lending the caller's memory to libzmq costs more than that. */
#define LENT_BYTES ((size_t)1 << 14)
#define MOST_ARRAYS 4 /* of one request, CORRECT */
#define MOST_TOLD 3   /* of one trial: JUDGE, CORRECT, JUDGE */

typedef enum { DONE, LOST, FAILED } outcome; /* LOST: the connection ended, the request may have been executed or not */

/* A line of numbered requests: one for the control endpoint, one for each session. */
typedef struct {
    uint8_t client[MMI_CLIENT_BYTES];
    int64_t sequence;
} line;

/* The number of a request that was given up without an answer, 0 = none, and its content. */
typedef struct {
    int64_t number;
    uint64_t content;
} unanswered;

typedef struct {
    void *socket, *events;
    atomic_int lent; /* frames of the caller's memory that libzmq still reads */
    char endpoint[ENDPOINT_BYTES];
} connection;

typedef struct {
    char key[64], text[64];
    mmi_kind kind;
    int64_t integer;
    double number;
} setting;

/* Rows of the mesh that are uploaded under one item and name. */
typedef struct {
    const char *item;
    char name[NAME_BYTES], role[16];
    const void *data;
    size_t rows, columns, width;
    int is_float;
    void *owned; /* the data, where they are ours */
} block;

typedef struct {
    const char *type, *reply;
    int64_t sequence, epoch; /* epoch: -1 where the request has none */
    const uint8_t *client;
    mmi_writer fields; /* all but the epoch, which a repeat may have another of */
    size_t field_count;
    block arrays[MOST_ARRAYS]; /* item = its name; NULL: no more */
} request;

/* What is told of an error. */
typedef struct {
    char code[64], message[1024], hint[512];
    mm_report details;
} told;

typedef struct {
    mmi_reply reply;
    zmq_msg_t *frames;
    size_t *sizes;
    size_t count, capacity;
} answer;

struct mm_context {
    mm_result error;
    told told;
    void *zmq;
    unsigned monitors; /* so many were made: their inproc addresses differ */
    pid_t process; /* the one that made it: no other one may use its sockets */
    mm_warning warning;
    void *warned; /* the first argument of warning */
    int is_silent;                /* a warning has said so */
    double asked_at, waits_until; /* the latest request to the control endpoint; the end of the call that waits */
    double timeout, compute_timeout;
    char secret_key[KEY_CHARACTERS + 1], public_key[KEY_CHARACTERS + 1], server_key[KEY_CHARACTERS + 1];
    char endpoint[ENDPOINT_BYTES];
    connection control;
    line line;
    mm_report welcome, listed;
    mm_session *sessions;
};

/* Nodes that a correction has moved, as numbered here, and their displacement from the reference mesh. */
typedef struct {
    int64_t step, *nodes;
    double *displacement;
    size_t count;
} freed;

struct mm_session {
    mm_context *context;
    mm_session *next;
    /* what it is opened with */
    int dimension, partition, partitions;
    size_t nodes, block_count, block_capacity, setting_count, setting_capacity;
    block *blocks; /* [0] the points, [1] the global ids, then cells and patches as they came */
    setting *settings;
    char label[NAME_BYTES], durability[16], report[16];
    /* where it is */
    char id[MM_ID_SIZE];
    uint8_t token[MM_TOKEN_BYTES];
    int64_t epoch;
    connection data;
    line line;
    unanswered request; /* of the session's own line … */
    unanswered opening; /* … and its OPEN or RESUME, in the context's line: each session may have one */
    int joined;
    int may_resume; /* it is built, and nobody else takes part: this side may resume it when its worker is gone */
    size_t part, part_row; /* the next UPLOAD: block and row */
    /* how it stands */
    char state[16];
    int64_t step, durable_step, iteration, final_step, compute_limit_ms;
    uint8_t digest[32];
    int64_t *moving;
    size_t moving_count;
    double *enrichment;
    size_t enrichment_count;
    /* the MOVE that made the trial, made again where a worker's end has lost it */
    double *trial;
    int has_trial;
    mm_frame trial_frame;
    /* evaluation = "client": */
    int evaluates;
    struct mmv_volume *volume;
    request told[MOST_TOLD]; /* of the trial, once they are accepted; their arrays are ours */
    size_t told_count;
    freed trial_freed, committed_freed; /* where the last correction put nodes */
    mm_report built, moved, committed, status;
};

/* --- errors ------------------------------------------------------------------------------------------------------ */

static mm_result category(const char *code)
{
    static const struct {
        const char *name;
        mm_result result;
    } NAMES[] = {
        {"INVALID_ARGUMENT", MM_INVALID_ARGUMENT},
        {"DEADLINE_EXCEEDED", MM_DEADLINE_EXCEEDED},
        {"NOT_FOUND", MM_NOT_FOUND},
        {"PERMISSION_DENIED", MM_PERMISSION_DENIED},
        {"RESOURCE_EXHAUSTED", MM_RESOURCE_EXHAUSTED},
        {"FAILED_PRECONDITION", MM_FAILED_PRECONDITION},
        {"ABORTED", MM_ABORTED},
        {"UNIMPLEMENTED", MM_UNIMPLEMENTED},
        {"UNAVAILABLE", MM_UNAVAILABLE},
        {"DATA_LOSS", MM_DATA_LOSS},
        {"UNAUTHENTICATED", MM_UNAUTHENTICATED},
    };
    size_t size = strcspn(code, ".");
    for (size_t i = 0; i < sizeof NAMES / sizeof *NAMES; ++i) {
        if (strlen(NAMES[i].name) == size && strncmp(code, NAMES[i].name, size) == 0) {
            return NAMES[i].result;
        }
    }
    return MM_INTERNAL;
}

/* The error of this call, in place of what may have been there. */
__attribute__((format(printf, 4, 5))) static outcome fail(mm_context *context, const char *code, const char *hint,
                                                          const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(context->told.message, sizeof context->told.message, format, arguments);
    va_end(arguments);
    snprintf(context->told.code, sizeof context->told.code, "%s", code);
    snprintf(context->told.hint, sizeof context->told.hint, "%s", hint);
    mmi_report_free(&context->told.details);
    context->error = category(code);
    return FAILED;
}

static outcome no_memory(mm_context *context)
{
    return fail(context, "RESOURCE_EXHAUSTED.MEMORY", "", "there is no memory on this side");
}

static outcome lost(mm_context *context, const char *format, const char *what)
{
    char message[ENDPOINT_BYTES + 64];
    snprintf(message, sizeof message, format, what);
    fail(context, "UNAVAILABLE", "", "%s", message);
    return LOST;
}

/* ERROR as the server sent it; its details keep the reply's memory. */
static outcome fail_as(mm_context *context, answer *from)
{
    mm_report *report = &from->reply.report;
    char code[sizeof context->told.code], message[sizeof context->told.message], hint[sizeof context->told.hint];
    mmi_copy_text(report, mmi_find(report, report->root, "code", 4), code, sizeof code);
    mmi_copy_text(report, mmi_find(report, report->root, "message", 7), message, sizeof message);
    mmi_copy_text(report, mmi_find(report, report->root, "hint", 4), hint, sizeof hint);
    fail(context, code, hint, "%s", message);
    report->root = mmi_find(report, report->root, "details", 7);
    context->told.details = *report;
    *report = (mm_report){0};
    return FAILED;
}

mm_result mm_error(const mm_context *context) { return context ? context->error : MM_INVALID_ARGUMENT; }
const char *mm_error_code(const mm_context *context) { return context && context->error ? context->told.code : ""; }
const char *mm_error_message(const mm_context *context)
{
    return context && context->error ? context->told.message : "";
}
const char *mm_error_hint(const mm_context *context) { return context && context->error ? context->told.hint : ""; }

const mm_report *mm_error_details(const mm_context *context)
{
    return context && context->error ? &context->told.details : NULL;
}

int mm_error_is(const mm_context *context, const char *code)
{
    size_t size = strlen(code);
    const char *ours = mm_error_code(context);
    return size && strncmp(ours, code, size) == 0 && (ours[size] == '\0' || ours[size] == '.');
}

void mm_clear_error(mm_context *context)
{
    if (context) {
        context->error = MM_OK;
        mmi_report_free(&context->told.details);
    }
}

/* --- time, chance ------------------------------------------------------------------------------------------------ */

static double now(void)
{
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return (double)time.tv_sec + 1e-9 * (double)time.tv_nsec;
}

static double seconds_left(double deadline)
{
    double left = deadline - now();
    return left > 0.0 ? left : 0.0;
}

static void pause_for(double seconds)
{
    struct timespec time = {(time_t)seconds, (long)(1e9 * (seconds - (double)(time_t)seconds))};
    nanosleep(&time, NULL);
}

/* A random UUID; SPEC.md wants one for each line of requests. */
static outcome new_line(mm_context *context, line *line)
{
    int file = open("/dev/urandom", O_RDONLY | O_CLOEXEC);
    ssize_t count = file < 0 ? -1 : read(file, line->client, sizeof line->client);
    if (file >= 0) {
        close(file);
    }
    if (count != (ssize_t)sizeof line->client) {
        return fail(context, "INTERNAL", "", "/dev/urandom gives no random numbers");
    }
    line->client[6] = (uint8_t)((line->client[6] & 0x0f) | 0x40);
    line->client[8] = (uint8_t)((line->client[8] & 0x3f) | 0x80);
    return DONE;
}

/* --- connections ------------------------------------------------------------------------------------------------- */

static int is_forked(const mm_context *context) { return context->process != getpid(); }

/* A forked child has the parent's sockets, but not the threads that serve them: closing one would disturb the parent. */
static void abandon(connection *connection)
{
    connection->socket = connection->events = NULL;
    atomic_store(&connection->lent, 0);
}

static void disconnect(connection *connection)
{
    if (connection->socket) {
        zmq_socket_monitor(connection->socket, NULL, 0);
        if (connection->events) {
            zmq_close(connection->events);
        }
        zmq_close(connection->socket);
        connection->socket = connection->events = NULL;
    }
    /* without linger libzmq drops what it has not sent; only then may the caller have his arrays back */
    while (atomic_load(&connection->lent) > 0) {
        pause_for(0.001);
    }
}

static void set_option(void *socket, int option, int value) { zmq_setsockopt(socket, option, &value, sizeof value); }

static int set_keys(const mm_context *context, void *socket)
{
    return !context->secret_key[0]
           || (zmq_setsockopt(socket, ZMQ_CURVE_SERVERKEY, context->server_key, KEY_CHARACTERS + 1) == 0
               && zmq_setsockopt(socket, ZMQ_CURVE_PUBLICKEY, context->public_key, KEY_CHARACTERS + 1) == 0
               && zmq_setsockopt(socket, ZMQ_CURVE_SECRETKEY, context->secret_key, KEY_CHARACTERS + 1) == 0);
}

static outcome connect_to(mm_context *context, connection *connection, const char *endpoint)
{
    char monitor[48];
    /* no frame of a reply is larger; encrypted ones are by some bytes */
    int64_t largest = MMI_CHUNK_BYTES + 4096;
    disconnect(connection);
    snprintf(connection->endpoint, sizeof connection->endpoint, "%s", endpoint);
    snprintf(monitor, sizeof monitor, "inproc://mesh-motion-%u", context->monitors++);
    void *socket = connection->socket = zmq_socket(context->zmq, ZMQ_DEALER);
    if (!socket) {
        return fail(context, "RESOURCE_EXHAUSTED", "", "no socket: %s", zmq_strerror(zmq_errno()));
    }
    set_option(socket, ZMQ_LINGER, 0);
    /* no call lasts longer, whatever has been forgotten: a send does not wait, a receive follows a poll */
    set_option(socket, ZMQ_SNDTIMEO, 60000);
    set_option(socket, ZMQ_RCVTIMEO, 60000);
    set_option(socket, ZMQ_RECONNECT_IVL, 50);
    set_option(socket, ZMQ_RECONNECT_IVL_MAX, 1000);
    set_option(socket, ZMQ_HEARTBEAT_IVL, 5000);
    set_option(socket, ZMQ_HEARTBEAT_TIMEOUT, 20000);
    set_option(socket, ZMQ_IPV6, strchr(endpoint, '[') != NULL);
    zmq_setsockopt(socket, ZMQ_MAXMSGSIZE, &largest, sizeof largest);
    int events = ZMQ_EVENT_DISCONNECTED | ZMQ_EVENT_HANDSHAKE_FAILED_AUTH | ZMQ_EVENT_HANDSHAKE_FAILED_PROTOCOL;
    if (zmq_socket_monitor(socket, monitor, events) == 0) {
        connection->events = zmq_socket(context->zmq, ZMQ_PAIR);
    }
    if (!connection->events || zmq_connect(connection->events, monitor) != 0) {
        disconnect(connection);
        return fail(context, "RESOURCE_EXHAUSTED", "", "no socket: %s", zmq_strerror(zmq_errno()));
    }
    if (!set_keys(context, socket)) {
        disconnect(connection);
        return fail(context, "INVALID_ARGUMENT", "a libzmq with libsodium has CURVE", "libzmq does not take the keys");
    }
    if (zmq_connect(socket, endpoint) != 0) {
        disconnect(connection);
        return fail(context, "INVALID_ARGUMENT", "", "endpoint must be tcp://HOST:PORT or ipc:///path, got '%s'",
                    endpoint);
    }
    return DONE;
}

static int is_readable(void *socket)
{
    zmq_pollitem_t item = {socket, 0, ZMQ_POLLIN, 0};
    return zmq_poll(&item, 1, 0) > 0;
}

/* One event of the monitor: two frames, of which the first has the number and a value. */
static void take_event(void *events, int *event, uint32_t *value)
{
    uint8_t head[6] = {0};
    char address[ENDPOINT_BYTES];
    uint16_t number;
    zmq_recv(events, head, sizeof head, 0);
    zmq_recv(events, address, sizeof address, 0);
    memcpy(&number, head, sizeof number);
    memcpy(value, head + 2, sizeof *value);
    *event = number;
}

/* LOST if the connection has ended since it was looked at last. */
static outcome check_connected(mm_context *context, connection *connection)
{
    int ended = 0;
    while (is_readable(connection->events)) {
        int event;
        uint32_t value;
        take_event(connection->events, &event, &value);
        if (event == ZMQ_EVENT_HANDSHAKE_FAILED_AUTH) {
            disconnect(connection); /* for the next call to try anew */
            return fail(context, "UNAUTHENTICATED", "its operator admits a key with `mesh-motion keys allow`",
                        "the server at %s does not admit this key", connection->endpoint);
        }
        if (event == ZMQ_EVENT_HANDSHAKE_FAILED_PROTOCOL && value == ZMQ_PROTOCOL_ERROR_ZMTP_MECHANISM_MISMATCH) {
            disconnect(connection);
            return fail(context, "UNAUTHENTICATED",
                        "give keys for a server that was started with --keys, and none for any other",
                        "the server at %s and this client do not agree whether there are keys", connection->endpoint);
        }
        ended = 1;
    }
    return ended ? lost(context, "the connection to %s ended", connection->endpoint) : DONE;
}

/* --- requests ---------------------------------------------------------------------------------------------------- */

static request new_request(const char *type, const char *reply)
{
    request made = {0};
    made.type = type;
    made.reply = reply;
    made.epoch = -1;
    return made;
}

static void add_text(request *request, const char *key, const char *value)
{
    ++request->field_count;
    mmi_put_text(&request->fields, key);
    mmi_put_text(&request->fields, value);
}

static void add_integer(request *request, const char *key, int64_t value)
{
    ++request->field_count;
    mmi_put_text(&request->fields, key);
    mmi_put_integer(&request->fields, value);
}

static void add_flag(request *request, const char *key, int value)
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

static block make_block(const char *item, const void *data, size_t rows, size_t columns, size_t width)
{
    block made = {0};
    made.item = item;
    made.data = data;
    made.rows = rows;
    made.columns = columns;
    made.width = width;
    return made;
}

static size_t array_bytes(const block *array) { return array->item ? array->rows * array->columns * array->width : 0; }

static uint64_t hashed(uint64_t hash, const void *data, size_t size)
{
    const uint8_t *bytes = data;
    for (size_t i = 0; i < size; ++i) {
        hash = (hash ^ bytes[i]) * UINT64_C(1099511628211);
    }
    return hash;
}

/* FNV-1a over what makes a request this request: the caller's array may have changed since. */
static uint64_t content_of(const request *request)
{
    uint64_t hash = UINT64_C(14695981039346656037);
    hash = hashed(hash, request->type, strlen(request->type));
    hash = hashed(hash, request->fields.data, request->fields.size);
    for (const block *array = request->arrays; array < request->arrays + MOST_ARRAYS && array->item; ++array) {
        size_t shape[2] = {array->rows, array->columns};
        hash = hashed(hash, shape, sizeof shape);
        hash = hashed(hash, array->data, array_bytes(array));
    }
    return hash;
}

/* Those of which the server keeps the reply (SPEC 10.7). Others get a number each time: a late reply tells what was. */
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

/* The next number; a repeat of what was given up unanswered keeps its own, so that it is executed once. */
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

/* Nobody has answered, or not in words that we know: it is not known what was done. */
static int is_unheard(const mm_context *context)
{
    return context->error == MM_DEADLINE_EXCEEDED || context->error == MM_UNAVAILABLE || context->error == MM_INTERNAL;
}

/* So that the caller may ask again. */
static void remember_unanswered(mm_context *context, unanswered *kept, const request *request)
{
    if (is_kept(request) && (is_unheard(context) || mm_error_is(context, "RESOURCE_EXHAUSTED.MEMORY"))) {
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
        mmi_put_array(out, 2);
        mmi_put_integer(out, (int64_t)array->rows);
        mmi_put_integer(out, (int64_t)array->columns);
    }
}

static void give_back(void *data, void *lent)
{
    (void)data;
    atomic_fetch_sub((atomic_int *)lent, 1);
}

/* A frame that is the caller's memory where it is large; libzmq reads it until it calls give_back. */
static int make_frame(connection *connection, zmq_msg_t *frame, const uint8_t *bytes, size_t size)
{
    if (size < LENT_BYTES) {
        if (zmq_msg_init_size(frame, size) != 0) {
            return -1;
        }
        memcpy(zmq_msg_data(frame), bytes, size);
        return 0;
    }
    /* libzmq takes a pointer to what it may write, but does not write what it sends */
    union {
        const uint8_t *read_only;
        void *any;
    } lent = {bytes};
    atomic_fetch_add(&connection->lent, 1);
    if (zmq_msg_init_data(frame, lent.any, size, give_back, &connection->lent) != 0) {
        atomic_fetch_sub(&connection->lent, 1);
        return -1;
    }
    return 0;
}

static int send_frame(connection *connection, const uint8_t *bytes, size_t size, int more)
{
    zmq_msg_t frame;
    if (make_frame(connection, &frame, bytes, size) != 0) {
        return -1;
    }
    while (zmq_msg_send(&frame, connection->socket, ZMQ_DONTWAIT | (more ? ZMQ_SNDMORE : 0)) < 0) {
        if (zmq_errno() != EINTR) {
            zmq_msg_close(&frame);
            return -1;
        }
    }
    return 0;
}

static outcome send_request(mm_context *context, connection *connection, const request *request)
{
    mmi_writer header = {0};
    size_t left = 0; /* of all arrays */
    for (int i = 0; i < MOST_ARRAYS; ++i) {
        left += array_bytes(&request->arrays[i]);
    }
    pack_header(&header, request);
    if (header.failed || request->fields.failed) {
        mmi_writer_free(&header);
        return fail(context, "RESOURCE_EXHAUSTED.BYTES", "", "the header of %s has more than %u bytes", request->type,
                    MMI_HEADER_BYTES);
    }
    int sent = send_frame(connection, header.data, header.size, left > 0);
    mmi_writer_free(&header);
    for (int i = 0; i < MOST_ARRAYS; ++i) {
        const uint8_t *bytes = request->arrays[i].data;
        size_t of_array = array_bytes(&request->arrays[i]);
        while (sent == 0 && of_array) {
            size_t chunk = of_array < MMI_CHUNK_BYTES ? of_array : MMI_CHUNK_BYTES;
            of_array -= chunk;
            left -= chunk;
            sent = send_frame(connection, bytes, chunk, left > 0);
            bytes += chunk;
        }
    }
    if (sent != 0) {
        /* libzmq has queued all that it takes for somebody who does not read */
        disconnect(connection);
        return lost(context, "%s takes no more requests", connection->endpoint);
    }
    return DONE;
}

/* --- replies ----------------------------------------------------------------------------------------------------- */

static void free_answer(answer *from)
{
    for (size_t i = 0; i < from->count; ++i) {
        zmq_msg_close(&from->frames[i]);
    }
    free(from->frames);
    free(from->sizes);
    mmi_report_free(&from->reply.report);
    *from = (answer){0};
}

/* Room for so many frames at once: libzmq's messages must not be moved about in memory. */
static int make_room(answer *to, size_t frames)
{
    to->frames = malloc(frames * sizeof *to->frames);
    to->sizes = malloc(frames * sizeof *to->sizes);
    to->capacity = frames;
    return to->frames && to->sizes;
}

/* Of a reply to this session: frame 0 and arrays, of which none has more than three numbers a node. What is not known
 * yet, before JOINED tells it, is taken for large, and so is a field. */
static size_t most_frames(const mm_session *session)
{
    size_t nodes = session ? session->nodes && !session->evaluates ? session->nodes : UNKNOWN_NODES : 0;
    return 1 + MMI_MOST_ARRAYS * ((nodes * 3 * sizeof(double) + MMI_CHUNK_BYTES - 1) / MMI_CHUNK_BYTES);
}

/* What came is no message; what follows it on that connection cannot be trusted either. */
static outcome damaged(mm_context *context, connection *connection, const char *wrong)
{
    disconnect(connection);
    return fail(context, "INTERNAL", "the same call may be made again: it is done once",
                "the server's reply is no message: %s", wrong);
}

/* All frames of the next message; ZeroMQ hands out whole messages only. */
static outcome receive(mm_context *context, connection *connection, const mm_session *session, answer *to)
{
    int more = 1;
    free_answer(to);
    if (!make_room(to, most_frames(session))) {
        disconnect(connection); /* the message goes with it */
        return no_memory(context);
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
            return lost(context, "the connection to %s ended", connection->endpoint);
        }
        to->sizes[to->count++] = (size_t)size;
        more = zmq_msg_more(frame);
    }
    const uint8_t *header = zmq_msg_data(&to->frames[0]);
    const char *wrong = mmi_read_header(&to->reply, header, to->sizes[0]);
    return wrong ? damaged(context, connection, wrong) : DONE;
}

static outcome watch(mm_session *session, double deadline);

/* Say once that no server answers: the call may go on waiting for half an hour. */
static void warn_of_silence(mm_context *context, const request *request)
{
    int starts = strcmp(request->type, "OPEN") == 0 || strcmp(request->type, "RESUME") == 0;
    if (context->is_silent || now() - context->asked_at < (starts ? STARTING_SECONDS : SILENT_SECONDS)) {
        return;
    }
    context->is_silent = 1;
    char line[ENDPOINT_BYTES + 128];
    snprintf(line, sizeof line, "%s%s at %s; asking for %.0f s", starts ? request->type : "no server answers",
             starts ? " is not answered" : "", context->endpoint, seconds_left(context->waits_until));
    if (context->warning) {
        context->warning(context->warned, line);
    }
}

/* Until there is a message. `watched` is the session whose worker may be gone without the connection's end. */
static outcome wait_for_message(mm_context *context, connection *connection, const request *request, double deadline,
                                mm_session *watched)
{
    while (!is_readable(connection->socket)) {
        double left = seconds_left(deadline);
        zmq_pollitem_t items[2] = {{connection->socket, 0, ZMQ_POLLIN, 0}, {connection->events, 0, ZMQ_POLLIN, 0}};
        zmq_poll(items, 2, (long)ceil(1000.0 * (left < WATCH_SECONDS ? left : WATCH_SECONDS)));
        if (is_readable(connection->socket)) {
            break;
        }
        if (connection == &context->control) {
            warn_of_silence(context, request);
        }
        outcome how = check_connected(context, connection);
        if (how == DONE && seconds_left(deadline) == 0.0) {
            disconnect(connection); /* it may be dead without a word */
            how = fail(context, "DEADLINE_EXCEEDED", "the same call may be made again: it is done once",
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

/* The message is the reply to this request: is it the right one? */
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
        return fail(context, "INTERNAL", "", "the reply to %s must be %s, got %s", request->type, request->reply,
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
        /* others are late replies to earlier requests */
        if (got->reply.sequence == request->sequence
            && memcmp(got->reply.client, request->client, MMI_CLIENT_BYTES) == 0) {
            return judge(context, connection, request, got);
        }
    }
}

/* The caller's arrays are his own again when a call returns, whatever became of the request. */
static void take_back_arrays(connection *connection)
{
    for (int i = 0; i < 50 && atomic_load(&connection->lent) > 0; ++i) {
        pause_for(0.001);
    }
    if (atomic_load(&connection->lent) > 0) {
        disconnect(connection);
    }
}

static outcome exchange(mm_context *context, connection *connection, const request *request, double deadline,
                        mm_session *watched, answer *got)
{
    outcome how = check_connected(context, connection);
    if (how == DONE) {
        how = send_request(context, connection, request);
    }
    if (how == DONE) {
        how = await_reply(context, connection, request, deadline, watched, got);
    }
    take_back_arrays(connection);
    return how;
}

static uint32_t field(const answer *from, const char *name)
{
    return mmi_find(&from->reply.report, from->reply.report.root, name, strlen(name));
}

static int64_t integer_field(const answer *from, const char *name)
{
    return mm_report_integer(&from->reply.report, name, 0);
}

static void keep_report(mm_report *to, answer *from)
{
    mmi_report_free(to);
    *to = from->reply.report;
    from->reply.report = (mm_report){0};
}

static void copy_numbers(double *to, const answer *from, const mmi_array *array)
{
    for (size_t i = array->first_frame; i < array->first_frame + array->frames; ++i) {
        size_t count = from->sizes[i] / array->width;
        mmi_copy_numbers(to, zmq_msg_data(&from->frames[i]), count, array->width);
        to += count;
    }
}

static void copy_integers(int64_t *to, const answer *from, const mmi_array *array)
{
    for (size_t i = array->first_frame; i < array->first_frame + array->frames; ++i) {
        size_t count = from->sizes[i] / array->width;
        mmi_copy_integers(to, zmq_msg_data(&from->frames[i]), count, array->width);
        to += count;
    }
}

/* --- the control endpoint ---------------------------------------------------------------------------------------- */

/* Until it is answered or the time is over; frees the request. `opening` remembers an unanswered one; NULL for what is not
 * kept. */
static outcome ask(mm_context *context, unanswered *opening, request *request, double seconds, answer *got)
{
    double deadline = now() + seconds;
    outcome how;
    context->asked_at = now();
    context->waits_until = fmax(context->waits_until, deadline);
    number(&context->line, opening, request);
    for (;;) {
        how = context->control.socket ? DONE : connect_to(context, &context->control, context->endpoint);
        if (how == DONE) {
            how = exchange(context, &context->control, request, deadline, NULL, got);
        }
        if (how == LOST) {
            disconnect(&context->control);
        }
        if (how == DONE || context->error != MM_UNAVAILABLE || seconds_left(deadline) <= PAUSE_SECONDS) {
            break;
        }
        mm_clear_error(context);
        pause_for(PAUSE_SECONDS);
    }
    context->is_silent = context->is_silent && is_unheard(context);
    remember_unanswered(context, opening, request);
    mmi_writer_free(&request->fields);
    return how;
}

static request request_about(const mm_session *session, const char *type, const char *reply)
{
    request about = new_request(type, reply);
    add_text(&about, "session", session->id);
    add_bytes(&about, "token", session->token, MM_TOKEN_BYTES);
    return about;
}

static outcome probe(mm_session *session, double seconds, answer *got)
{
    request about = request_about(session, "PROBE", "PROBED");
    return ask(session->context, NULL, &about, seconds, got);
}

static outcome resume(mm_session *session, double seconds, answer *got)
{
    request about = request_about(session, "RESUME", "RESUMED");
    return ask(session->context, &session->opening, &about, seconds, got);
}

/* A RESUME of ours has not been answered: the epoch may be higher than we know, and yet the session be ours. */
static int is_resuming(const mm_session *session)
{
    request about = request_about(session, "RESUME", "RESUMED");
    int is = session->opening.number && session->opening.content == content_of(&about);
    mmi_writer_free(&about.fields);
    return is;
}

/* A host of all addresses stands for the one by which the control endpoint is reached (SPEC 2.3). */
static void data_endpoint(const mm_context *context, const answer *from, char *to, size_t size)
{
    static const char *const ANYWHERE[] = {"tcp://0.0.0.0:", "tcp://[::]:", "tcp://*:"};
    char told[ENDPOINT_BYTES];
    const char *port = strrchr(context->endpoint, ':');
    mm_report_text(&from->reply.report, "endpoint", told, sizeof told);
    snprintf(to, size, "%s", told);
    for (size_t i = 0; i < sizeof ANYWHERE / sizeof *ANYWHERE; ++i) {
        size_t prefix = strlen(ANYWHERE[i]);
        if (strncmp(told, ANYWHERE[i], prefix) == 0 && port) {
            snprintf(to, size, "%.*s:%s", (int)(port - context->endpoint), context->endpoint, told + prefix);
        }
    }
}

/* --- the data endpoint ------------------------------------------------------------------------------------------- */

static request session_request(const mm_session *session, const char *type, const char *reply)
{
    request made = new_request(type, reply);
    made.epoch = session->epoch;
    add_text(&made, "session", session->id);
    add_integer(&made, "partition", session->partition);
    return made;
}

/* Connect to the worker and prove the right to the session. The caller frees `got`. */
static outcome join_worker(mm_session *session, const char *endpoint, int64_t epoch, double seconds, answer *got)
{
    mm_context *context = session->context;
    outcome how = connect_to(context, &session->data, endpoint);
    if (how != DONE) {
        return how;
    }
    session->epoch = epoch;
    request join = session_request(session, "JOIN", "JOINED");
    add_bytes(&join, "token", session->token, MM_TOKEN_BYTES);
    join.client = session->line.client;
    join.sequence = ++session->line.sequence;
    how = exchange(context, &session->data, &join, now() + seconds, session, got);
    mmi_writer_free(&join.fields);
    if (how != DONE) {
        disconnect(&session->data); /* nothing but JOIN may come first on a connection */
    }
    return how;
}

static outcome check_unfenced(mm_session *session, const answer *probed)
{
    if (integer_field(probed, "epoch") <= session->epoch) {
        return DONE;
    }
    return fail(session->context, "ABORTED.FENCED", "give this session up, or resume it again from here",
                "the session was resumed by another holder (epoch %" PRId64 ")", integer_field(probed, "epoch"));
}

/* While a request is computed: does the worker still live, and for us? */
static outcome watch(mm_session *session, double deadline)
{
    mm_context *context = session->context;
    answer probed = {0};
    double left = seconds_left(deadline);
    outcome how = probe(session, left < PROBE_SECONDS ? left : PROBE_SECONDS, &probed);
    if (how == DONE) {
        const mm_report *report = &probed.reply.report;
        uint32_t worker = field(&probed, "worker");
        if (mmi_is_text(report, worker, "dead") || mmi_is_text(report, worker, "none")) {
            how = lost(context, "the worker of session %s is gone", session->id);
        } else {
            how = check_unfenced(session, &probed);
        }
    } else if (context->error == MM_DEADLINE_EXCEEDED || context->error == MM_UNAVAILABLE) {
        mm_clear_error(context);
        how = DONE;
    }
    free_answer(&probed);
    return how;
}

/* What PROBE tells of the worker, once it does not start any more. */
static outcome probe_started(mm_session *session, double deadline, char *worker, size_t size, answer *got)
{
    for (;;) {
        outcome how = probe(session, seconds_left(deadline), got);
        if (how != DONE) {
            return how;
        }
        mm_report_text(&got->reply.report, "worker", worker, size);
        if (strcmp(worker, "starting") != 0) {
            return DONE;
        }
        if (seconds_left(deadline) == 0.0) {
            return fail(session->context, "UNAVAILABLE.STARTING", "try again",
                        "the session's worker is still starting");
        }
        pause_for(PAUSE_SECONDS / 2);
    }
}

/* Where the session is now (SPEC 11.1): with the same worker, or with another one that resumes from the journal. */
static outcome find_worker(mm_session *session, double deadline, answer *got)
{
    char worker[16] = "";
    if (is_resuming(session)) {
        return resume(session, seconds_left(deadline), got);
    }
    outcome how = probe_started(session, deadline, worker, sizeof worker, got);
    if (how != DONE) {
        return how;
    }
    if (strcmp(worker, "alive") == 0) {
        return check_unfenced(session, got);
    }
    if (session->may_resume) {
        return resume(session, seconds_left(deadline), got);
    }
    return fail(session->context, "UNAVAILABLE.WORKER",
                "resume the session from one partition and join it from the others; one that was never built is to be "
                "opened again",
                "the session's worker is %s", worker);
}

/* Where the session stands, which with durability "relaxed" may be behind what was answered before (SPEC 21.5). */
static outcome take_step(mm_session *session, int64_t step)
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
    fail(context, "ABORTED.STEPS_LOST",
         "go on from mm_step: the same moves and commits give the same coordinates again",
         "step %" PRId64 " was committed, but after a restart the session stands at step %" PRId64, known, step);
    mmi_put_map(&details, 1);
    mmi_put_text(&details, "details");
    mmi_put_map(&details, 2);
    mmi_put_text(&details, "expected");
    mmi_put_integer(&details, step + 1);
    mmi_put_text(&details, "got");
    mmi_put_integer(&details, known + 1);
    if (!details.failed && !mmi_parse(&context->told.details, details.data, details.size)) {
        context->told.details.root = mmi_find(&context->told.details, 0, "details", 7);
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
        data_endpoint(session->context, &found, endpoint, sizeof endpoint);
        how = join_worker(session, endpoint, integer_field(&found, "epoch"), seconds_left(deadline), &joined);
    }
    if (how == DONE && integer_field(&joined, "step") < session->step) {
        how = take_step(session, integer_field(&joined, "step"));
    }
    free_answer(&found);
    free_answer(&joined);
    return how;
}

/* Once, under the epoch that holds, over a new connection if the old one is gone. */
static outcome request_data(mm_session *session, request *request, double deadline, answer *got)
{
    outcome how = session->data.socket ? DONE : recover(session, deadline);
    if (how == DONE) {
        request->epoch = session->epoch;
        how = exchange(session->context, &session->data, request, deadline, session, got);
    }
    if (how == LOST) {
        disconnect(&session->data);
    }
    return how;
}

static request move_request(const mm_session *session, mm_frame frame, const double *rows)
{
    request move = session_request(session, "MOVE", "MOVED");
    add_integer(&move, "step", session->step + 1);
    add_text(&move, "frame", frame == MM_SINCE_REFERENCE ? "reference" : "committed");
    add_text(&move, "report", session->report);
    move.arrays[0] = make_block("displacement", rows, session->moving_count, (size_t)session->dimension, 8);
    move.arrays[0].is_float = 1;
    return move;
}

/* Make the lost trial again: a MOVE depends on nothing but the committed state (SPEC 7.1, 11.4). */
static outcome repeat_trial(mm_session *session, double deadline)
{
    answer moved = {0};
    request move = move_request(session, session->trial_frame, session->trial);
    mm_clear_error(session->context);
    move.client = session->line.client;
    move.sequence = ++session->line.sequence;
    outcome how = request_data(session, &move, deadline, &moved);
    mmi_writer_free(&move.fields);
    free_answer(&moved);
    for (size_t i = 0; how == DONE && i < session->told_count; ++i) {
        session->told[i].client = session->line.client;
        session->told[i].sequence = ++session->line.sequence;
        how = request_data(session, &session->told[i], deadline, &moved);
        free_answer(&moved);
    }
    return how;
}

/* Send a request until it is answered; frees the request. What was given up unanswered keeps its number. */
static outcome deliver(mm_session *session, request *request, double seconds, answer *got)
{
    mm_context *context = session->context;
    double deadline = now() + seconds;
    outcome how = LOST;
    context->waits_until = deadline;
    number(&session->line, &session->request, request);
    for (int attempt = 0; attempt < ATTEMPTS && how == LOST; ++attempt) {
        if (attempt > 1) { /* a server may need a moment to see that its worker is gone */
            pause_for(fmin((1 << (attempt - 1)) * PAUSE_SECONDS, seconds_left(deadline)));
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
        fail(context, "UNAVAILABLE", "", "%s broke %d connections to %s", request->type, ATTEMPTS,
             session->data.endpoint);
    }
    remember_unanswered(context, &session->request, request);
    mmi_writer_free(&request->fields);
    return how;
}

/* --- a server ---------------------------------------------------------------------------------------------------- */

static mm_result fail_forked(mm_context *context)
{
    fail(context, "FAILED_PRECONDITION",
         "make a context of its own in the child, connect, and resume the session by its id and token",
         "a forked child cannot use the connections of its parent (process %ld)", (long)context->process);
    return context->error;
}

/* Where standard error is open: without it the descriptor may be that of anything. */
static void warn_on_standard_error(void *unused, const char *line)
{
    (void)unused;
    fprintf(stderr, "mesh_motion: %s\n", line);
}

/* Every call begins with it: the first error stays. */
#define BEGIN(context)                                                                                                 \
    do {                                                                                                               \
        if (!(context)) {                                                                                              \
            return MM_INVALID_ARGUMENT;                                                                                \
        }                                                                                                              \
        if ((context)->error) {                                                                                        \
            return (context)->error;                                                                                   \
        }                                                                                                              \
        if (is_forked(context)) {                                                                                      \
            return fail_forked(context);                                                                               \
        }                                                                                                              \
    } while (0)
#define BEGIN_SESSION(session)                                                                                         \
    do {                                                                                                               \
        if (!(session)) {                                                                                              \
            return MM_INVALID_ARGUMENT;                                                                                \
        }                                                                                                              \
        BEGIN((session)->context);                                                                                     \
    } while (0)

mm_context *mm_context_new(void)
{
    mm_context *context = calloc(1, sizeof *context);
    if (!context) {
        return NULL;
    }
    context->timeout = 60.0;
    context->compute_timeout = 1800.0;
    context->process = getpid();
    context->warning = fcntl(STDERR_FILENO, F_GETFD) < 0 ? NULL : warn_on_standard_error;
    atomic_init(&context->control.lent, 0);
    context->zmq = zmq_ctx_new();
    if (!context->zmq) {
        free(context);
        return NULL;
    }
    new_line(context, &context->line); /* if it fails, the error is there for the first call */
    return context;
}

void mm_context_free(mm_context *context)
{
    if (!context) {
        return;
    }
    while (context->sessions) {
        mm_session_free(context->sessions);
    }
    if (!is_forked(context)) {
        disconnect(&context->control);
        zmq_ctx_term(context->zmq);
    }
    mmi_report_free(&context->told.details);
    mmi_report_free(&context->welcome);
    mmi_report_free(&context->listed);
    free(context);
}

mm_result mm_set_warning(mm_context *context, mm_warning warning, void *data)
{
    BEGIN(context);
    context->warning = warning;
    context->warned = data;
    return MM_OK;
}

mm_result mm_set_timeouts(mm_context *context, double seconds, double compute_seconds)
{
    BEGIN(context);
    /* libzmq counts milliseconds in a long, and a wait that never ends is none that we offer */
    if (!(seconds > 0.0 && seconds < 1e6 && compute_seconds > 0.0 && compute_seconds < 1e6)) {
        fail(context, "INVALID_ARGUMENT", "", "time-outs must be above 0 and below 1e6 s, got %g and %g", seconds,
             compute_seconds);
        return context->error;
    }
    context->timeout = seconds;
    context->compute_timeout = compute_seconds;
    return MM_OK;
}

/* "mesh-motion-KIND KEY NAME", one line, as `mesh-motion keys` writes it. */
static outcome read_key(mm_context *context, const char *path, const char *kind, char *key)
{
    char text[512] = "", word[32], name[80];
    struct stat status;
    FILE *file = fopen(path, "r");
    if (!file || fstat(fileno(file), &status) != 0) {
        if (file) {
            fclose(file);
        }
        return fail(context, "INVALID_ARGUMENT", "", "%s: cannot be read: %s", path, strerror(errno));
    }
    size_t size = fread(text, 1, sizeof text - 1, file);
    fclose(file);
    text[size] = '\0';
    if (strcmp(kind, "mesh-motion-secret") == 0 && (status.st_mode & 077)) {
        return fail(context, "INVALID_ARGUMENT", "make a new key if others may have read it, then chmod 600",
                    "%s: a secret key must be readable by its owner alone, got mode %04o", path,
                    (unsigned)status.st_mode & 07777u);
    }
    /* 41: a longer word is none of 40 characters */
    char found[KEY_CHARACTERS + 2];
    if (sscanf(text, "%31s %41s %79s", word, found, name) != 3 || strcmp(word, kind) != 0
        || strlen(found) != KEY_CHARACTERS) {
        return fail(context, "INVALID_ARGUMENT", "",
                    "%s: expected one line '%s KEY NAME', as `mesh-motion keys` writes it", path, kind);
    }
    memcpy(key, found, KEY_CHARACTERS + 1);
    return DONE;
}

mm_result mm_set_keys(mm_context *context, const char *secret_file, const char *server_key)
{
    BEGIN(context);
    if (!secret_file || !server_key) {
        fail(context, "INVALID_ARGUMENT", "",
             "both keys must be given: the client's secret one and the server's public one");
        return context->error;
    }
    char secret[KEY_CHARACTERS + 1], public[KEY_CHARACTERS + 1], server[KEY_CHARACTERS + 1] = "";
    if (read_key(context, secret_file, "mesh-motion-secret", secret) != DONE) {
        return context->error;
    }
    if (strlen(server_key) == KEY_CHARACTERS && access(server_key, F_OK) != 0) {
        memcpy(server, server_key, sizeof server);
    } else if (read_key(context, server_key, "mesh-motion-public", server) != DONE) {
        return context->error;
    }
    if (zmq_curve_public(public, secret) != 0) {
        fail(context, "INVALID_ARGUMENT", "a libzmq with libsodium has CURVE", "%s: libzmq does not take the key",
             secret_file);
        return context->error;
    }
    memcpy(context->secret_key, secret, sizeof secret);
    memcpy(context->public_key, public, sizeof public);
    memcpy(context->server_key, server, sizeof server);
    return MM_OK;
}

static mm_result keys_of_environment(mm_context *context)
{
    const char *secret = getenv("MESH_MOTION_KEY"), *server = getenv("MESH_MOTION_SERVER_KEY");
    secret = secret && *secret ? secret : NULL;
    server = server && *server ? server : NULL;
    if (context->secret_key[0] || (!secret && !server)) {
        return MM_OK;
    }
    if (!secret || !server) {
        fail(context, "INVALID_ARGUMENT", "",
             "MESH_MOTION_KEY and MESH_MOTION_SERVER_KEY must be set both, or neither");
        return context->error;
    }
    return mm_set_keys(context, secret, server);
}

mm_result mm_connect(mm_context *context, const char *endpoint)
{
    BEGIN(context);
    if (!endpoint || strlen(endpoint) >= ENDPOINT_BYTES) {
        fail(context, "INVALID_ARGUMENT", "", "endpoint must be tcp://HOST:PORT or ipc:///path");
        return context->error;
    }
    if (keys_of_environment(context) != MM_OK) {
        return context->error;
    }
    disconnect(&context->control);
    snprintf(context->endpoint, sizeof context->endpoint, "%s", endpoint);
    answer welcome = {0};
    request hello = new_request("HELLO", "WELCOME");
    add_text(&hello, "agent", AGENT);
    outcome how = ask(context, NULL, &hello, context->timeout, &welcome);
    if (how != DONE && (context->error == MM_DEADLINE_EXCEEDED || context->error == MM_UNAVAILABLE)) {
        fail(context, "UNAVAILABLE",
             context->secret_key[0]
                 ? "is it running (`mesh-motion serve`), and does it have the key that it is taken for?"
                 : "is it running (`mesh-motion serve`), and without --keys?",
             "no server answers at %s within %g s", endpoint, context->timeout);
    }
    if (how == DONE && mm_report_integer(&welcome.reply.report, "version.0", 0) != 1) {
        how = fail(context, "UNIMPLEMENTED.VERSION", "update the older side", "the server does not speak version 1");
    }
    if (how == DONE) {
        keep_report(&context->welcome, &welcome);
    } else {
        disconnect(&context->control);
        context->endpoint[0] = '\0';
    }
    free_answer(&welcome);
    return context->error;
}

static outcome check_has_server(mm_context *context)
{
    return context->endpoint[0] ? DONE : fail(context, "UNAVAILABLE", "call mm_connect first", "there is no server");
}

mm_result mm_ping(mm_context *context)
{
    BEGIN(context);
    if (check_has_server(context) == DONE) {
        answer pong = {0};
        request ping = new_request("PING", "PONG");
        ask(context, NULL, &ping, context->timeout, &pong);
        free_answer(&pong);
    }
    return context->error;
}

const mm_report *mm_welcome(const mm_context *context) { return context ? &context->welcome : NULL; }

mm_result mm_list(mm_context *context, const char *after)
{
    BEGIN(context);
    if (check_has_server(context) == DONE) {
        answer listed = {0};
        request list = new_request("LIST", "LISTED");
        add_text(&list, "after", after ? after : "");
        if (ask(context, NULL, &list, context->timeout, &listed) == DONE) {
            keep_report(&context->listed, &listed);
        }
        free_answer(&listed);
    }
    return context->error;
}

const mm_report *mm_listed(const mm_context *context) { return context ? &context->listed : NULL; }

/* --- a mesh and how it is moved ---------------------------------------------------------------------------------- */

static void free_blocks(mm_session *session)
{
    for (size_t i = 0; i < session->block_count; ++i) {
        free(session->blocks[i].owned);
    }
    session->block_count = 0;
}

static void forget_volume(mm_session *session);

mm_session *mm_session_new(mm_context *context)
{
    if (!context || context->error || (is_forked(context) && fail_forked(context))) {
        return NULL;
    }
    mm_session *session = calloc(1, sizeof *session);
    if (!session) {
        no_memory(context);
        return NULL;
    }
    session->context = context;
    session->partitions = 1;
    atomic_init(&session->data.lent, 0);
    snprintf(session->state, sizeof session->state, "NEW");
    if (new_line(context, &session->line) != DONE) {
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
    if (is_forked(session->context)) {
        abandon(&session->data);
    }
    disconnect(&session->data);
    free_blocks(session);
    forget_volume(session);
    free(session->blocks);
    free(session->settings);
    free(session->moving);
    free(session->enrichment);
    free(session->trial);
    mmi_report_free(&session->built);
    mmi_report_free(&session->moved);
    mmi_report_free(&session->committed);
    mmi_report_free(&session->status);
    free(session);
}

/* Room for one more of `size` bytes in a table that doubles. */
static void *one_more(mm_context *context, void *table, size_t count, size_t *capacity, size_t size)
{
    if (count < *capacity) {
        return table;
    }
    size_t larger = *capacity ? 2 * *capacity : 8;
    void *grown = realloc(table, larger * size);
    if (!grown) {
        no_memory(context);
        return NULL;
    }
    *capacity = larger;
    return grown;
}

static mm_result add_block(mm_session *session, const block *added)
{
    block *blocks =
        one_more(session->context, session->blocks, session->block_count, &session->block_capacity, sizeof *blocks);
    if (blocks) {
        session->blocks = blocks;
        blocks[session->block_count++] = *added;
    }
    return session->context->error;
}

static mm_result invalid(mm_context *context, const char *message, const char *got)
{
    fail(context, "INVALID_ARGUMENT", "", message, got);
    return context->error;
}

mm_result mm_points(mm_session *session, int dimension, size_t nodes, const double *points)
{
    BEGIN_SESSION(session);
    if (dimension < 1 || dimension > 3 || (nodes && !points)) {
        return invalid(session->context, "points must have 1, 2 or 3 coordinates%s", "");
    }
    block made = make_block("nodes", points, nodes, (size_t)dimension, 8);
    made.is_float = 1;
    if (session->volume) { /* of a mesh that was given before */
        forget_volume(session);
        free_blocks(session);
    }
    session->dimension = dimension;
    session->nodes = nodes;
    /* the points come first, and calling this again gives others */
    if (session->block_count && strcmp(session->blocks[0].item, "nodes") == 0) {
        session->blocks[0] = made;
        return MM_OK;
    }
    if (session->block_count) {
        return invalid(session->context, "mm_points must be called before cells, patches and global ids%s", "");
    }
    return add_block(session, &made);
}

static mm_result add_cells(mm_session *session, const char *type, size_t cells, const void *nodes, size_t width)
{
    static const struct {
        const char *type;
        size_t nodes;
    } TYPES[] = {{"line", 2},    {"triangle", 3}, {"quad", 4},      {"tetra", 4},
                 {"pyramid", 5}, {"wedge", 6},    {"hexahedron", 8}};
    BEGIN_SESSION(session);
    for (size_t i = 0; type && i < sizeof TYPES / sizeof *TYPES; ++i) {
        if (strcmp(type, TYPES[i].type) == 0 && (nodes || cells == 0)) {
            block made = make_block("cells", nodes, cells, TYPES[i].nodes, width);
            snprintf(made.name, sizeof made.name, "%s", type);
            return add_block(session, &made);
        }
    }
    return invalid(session->context,
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
        return invalid(session->context, "a patch must have a name of at most 256 bytes, and nodes; got '%s'",
                       name ? name : "");
    }
    for (size_t i = 0; role && i < sizeof ROLES / sizeof *ROLES; ++i) {
        if (strcmp(role, ROLES[i]) == 0) {
            block made = make_block("patch", indices, nodes, 1, 8);
            snprintf(made.name, sizeof made.name, "%s", name);
            snprintf(made.role, sizeof made.role, "%s", role);
            return add_block(session, &made);
        }
    }
    return invalid(session->context, "a patch's role must be one of moving, fixed, slip, symmetry, periodic; got '%s'",
                   role ? role : "");
}

mm_result mm_global_ids(mm_session *session, const int64_t *ids)
{
    BEGIN_SESSION(session);
    if (!session->dimension || (session->nodes && !ids)) {
        return invalid(session->context, "global ids are one for each node, and mm_points comes before them%s", "");
    }
    block made = make_block("global_ids", ids, session->nodes, 1, 8);
    return add_block(session, &made);
}

/* What belongs into OPEN is of no use behind it. */
#define BEGIN_UNOPENED(session)                                                                                        \
    do {                                                                                                               \
        BEGIN_SESSION(session);                                                                                        \
        if ((session)->joined) {                                                                                       \
            fail((session)->context, "FAILED_PRECONDITION.STATE", "", "the session is open already");                  \
            return (session)->context->error;                                                                          \
        }                                                                                                              \
    } while (0)

/* The place of a setting: a key that was set before is set anew. */
static setting *place_of(mm_session *session, const char *key)
{
    setting *settings = session->settings;
    for (size_t i = 0; i < session->setting_count; ++i) {
        if (strcmp(settings[i].key, key) == 0) {
            return &settings[i];
        }
    }
    settings =
        one_more(session->context, settings, session->setting_count, &session->setting_capacity, sizeof *settings);
    if (!settings) {
        return NULL;
    }
    session->settings = settings;
    return &settings[session->setting_count++];
}

static mm_result set(mm_session *session, const char *key, setting value)
{
    if (!key || !*key || strlen(key) >= sizeof value.key || session->setting_count >= MMI_CONTAINER_ITEMS) {
        return invalid(session->context, "there is no such setting: '%s'", key ? key : "");
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
        return invalid(session->context, "the setting '%s' must be finite", key ? key : "");
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
        return invalid(session->context, "the setting '%s' has no such choice", key ? key : "");
    }
    snprintf(made.text, sizeof made.text, "%s", value);
    return set(session, key, made);
}

mm_result mm_set_label(mm_session *session, const char *label)
{
    BEGIN_UNOPENED(session);
    if (!label || strlen(label) >= sizeof session->label) {
        return invalid(session->context, "a label has at most 256 bytes%s", "");
    }
    snprintf(session->label, sizeof session->label, "%s", label);
    return MM_OK;
}

mm_result mm_set_durability(mm_session *session, const char *durability)
{
    BEGIN_UNOPENED(session);
    if (!durability || strlen(durability) >= sizeof session->durability) {
        return invalid(session->context, "there is no such durability: '%s'", durability ? durability : "");
    }
    snprintf(session->durability, sizeof session->durability, "%s", durability);
    return MM_OK;
}

mm_result mm_set_evaluation(mm_session *session, const char *evaluation)
{
    BEGIN_UNOPENED(session);
    if (!evaluation || (strcmp(evaluation, "server") != 0 && strcmp(evaluation, "client") != 0)) {
        return invalid(session->context, "evaluation is by server or client, got '%s'", evaluation ? evaluation : "");
    }
    session->evaluates = strcmp(evaluation, "client") == 0;
    return MM_OK;
}

mm_result mm_set_partition(mm_session *session, int partition, int partitions)
{
    BEGIN_UNOPENED(session);
    if (partitions < 1 || partitions > 256 || partition < 0 || partition >= partitions) {
        fail(session->context, "INVALID_ARGUMENT.PARTITION", "", "partitions count from 0, at most 256; got %d of %d",
             partition, partitions);
        return session->context->error;
    }
    session->partition = partition;
    session->partitions = partitions;
    return MM_OK;
}

/* --- evaluation by the client (SPEC.md, section 23) --------------------------------------------------------------- */

#ifdef MM_EVALUATION

static void free_told(request *told)
{
    mmi_writer_free(&told->fields);
    for (int i = 0; i < MOST_ARRAYS; ++i) {
        free(told->arrays[i].owned);
    }
    *told = (request){0};
}

static void free_freed(freed *old)
{
    free(old->nodes);
    free(old->displacement);
    *old = (freed){0};
}

/* What was told of the trial. */
static void forget_told(mm_session *session)
{
    while (session->told_count) {
        free_told(&session->told[--session->told_count]);
    }
    free_freed(&session->trial_freed);
}

/* Send a request whose arrays are ours, and keep it to be sent again if `is_kept` says so of its answer. */
static outcome deliver_told(mm_session *session, request *made, int (*is_kept)(const mm_report *), answer *got)
{
    request sent = *made; /* deliver frees the fields of what it sends */
    sent.fields = (mmi_writer){0};
    mmi_put_raw(&sent.fields, made->fields.data, made->fields.size);
    outcome how = deliver(session, &sent, session->context->compute_timeout, got);
    if (how == DONE && is_kept(&got->reply.report)) {
        session->told[session->told_count++] = *made;
        *made = (request){0};
    }
    free_told(made);
    return how;
}

/* The trial is committed: its correction is that of the committed state, and nothing is to be told again. */
static void keep_freed(mm_session *session)
{
    freed kept = session->trial_freed;
    session->trial_freed = (freed){0};
    forget_told(session);
    free_freed(&session->committed_freed);
    session->committed_freed = kept;
}

static int is_answered(const mm_report *judged) { return !mm_report_count(judged, "questions"); }
static int is_corrected(const mm_report *corrected) { return !mm_report_count(corrected, "region"); }
static int is_never_kept(const mm_report *report)
{
    (void)report;
    return 0;
}

#define FEW_VALUES 512
#define MOST_QUESTIONS 200
#define MOST_DIVISIONS 6

/* A bin that JUDGE tells of. */
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
    const char *told = mesh_motion_kernels_error();
    return fail(session->context, code, "", "%s", *told ? told : "the field of the server does not fit together");
}

static void forget_volume(mm_session *session)
{
    forget_told(session);
    free_freed(&session->committed_freed);
    mmv_free(session->volume);
    session->volume = NULL;
}

/* From the caller's arrays, once. */
static outcome make_volume(mm_session *session)
{
    mm_context *context = session->context;
    if (session->volume || !session->evaluates) {
        return DONE;
    }
    if (!session->block_count) {
        return fail(context, "INVALID_ARGUMENT", "mm_points, mm_cells and mm_patch before mm_join or mm_resume",
                    "the volume of this session stays with the client, and the mesh is not known here");
    }
    mmv_volume *volume = mmv_new(session->dimension, session->nodes, session->blocks[0].data);
    int result = volume ? MESH_MOTION_OK : MESH_MOTION_OUT_OF_MEMORY;
    for (size_t i = 1; result == MESH_MOTION_OK && i < session->block_count; ++i) {
        const block *part = &session->blocks[i];
        if (strcmp(part->item, "cells") == 0) {
            result = mmv_add_cells(volume, part->name, part->rows, part->data, part->width);
        } else if (strcmp(part->item, "patch") == 0) {
            mmv_add_patch(volume, part->rows, part->data);
        } else if (strcmp(part->item, "global_ids") == 0) {
            result = mmv_set_ids(volume, part->data);
        }
    }
    int64_t alone = result == MESH_MOTION_OK ? mmv_without_cell(volume) : -1;
    if (alone >= 0) {
        mmv_free(volume);
        return fail(context, "INVALID_ARGUMENT.MESH", "leave it out, or open the session with evaluation = 'server'",
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

/* Rows of the caller's array for the nodes that are uploaded. */
static outcome gather_rows(mm_session *session, block *part)
{
    size_t count, row = part->columns * part->width;
    const int64_t *nodes = mmv_uploaded(session->volume, &count);
    uint8_t *rows = malloc(count * row + 1);
    if (!rows) {
        return no_memory(session->context);
    }
    for (size_t i = 0; i < count; ++i) {
        memcpy(rows + i * row, (const uint8_t *)part->data + (size_t)nodes[i] * row, row);
    }
    part->data = part->owned = rows;
    part->rows = count;
    return DONE;
}

/* What is uploaded in place of the mesh: its boundary, and how many cells it has. */
static outcome gather_blocks(mm_session *session)
{
    size_t count, had = session->block_count;
    const int64_t *nodes = mmv_uploaded(session->volume, &count);
    outcome how = DONE;
    int has_ids = 0;
    if (session->blocks[0].owned) {
        return DONE; /* by an earlier call */
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
            how = rows ? DONE : no_memory(session->context);
        } else {
            how = gather_rows(session, part);
        }
    }
    if (how == DONE && !has_ids) {
        block ids = make_block("global_ids", nodes, count, 1, 8);
        how = add_block(session, &ids) == MM_OK ? DONE : FAILED;
    }
    return how;
}

static outcome copy_array(mm_context *context, const answer *from, const char *name, double **to, size_t *rows)
{
    const mmi_array *array = mmi_find_array(&from->reply, name);
    *rows = array ? array->rows : 0;
    *to = malloc((array ? array->rows * array->columns : 0) * sizeof **to + 1);
    if (!*to) {
        return no_memory(context);
    }
    if (array) {
        copy_numbers(*to, from, array);
    }
    return DONE;
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

/* The displacement of all nodes from the reference mesh: by the field of a reply, and the rows of those uploaded. */
static outcome evaluate(mm_session *session, const answer *from, const double *known, double *to)
{
    mm_context *context = session->context;
    const mm_report *report = &from->reply.report;
    mmv_field field = {0};
    field.sum_count = mm_report_count(report, "sums");
    field.sums = calloc(field.sum_count + 1, sizeof *field.sums);
    if (!field.sums) {
        return no_memory(context);
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

/* The rows that a reply has of the uploaded nodes, in an array of the caller's. */
static outcome take_uploaded(mm_session *session, const answer *from, const char *name, double **rows)
{
    const mmi_array *array = mmi_find_array(&from->reply, name);
    size_t count, told;
    mmv_uploaded(session->volume, &count);
    if (array->rows != count || array->columns != (size_t)session->dimension) {
        return fail(session->context, "INVALID_ARGUMENT", "give the same points, cells and patches in the same order",
                    "the mesh is not the one that this session was opened with");
    }
    return copy_array(session->context, from, name, rows, &told);
}

/* Grows as it is appended to. */
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

/* What the cells have in the bin of a question, by its number. */
static outcome tell_bin(mm_session *session, const question *asked, size_t number, table *bins, table *values)
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
        result = found && repeated
                     ? mesh_motion_tally_bin(mmv_tally(session->volume), asked->metric, asked->divisions,
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

/* The JUDGE that answers questions. */
static outcome make_judge(mm_session *session, const mesh_motion_part *part, const question *asked, size_t count,
                          request *judge)
{
    table bins = {0}, values = {0}, worst = {0};
    outcome how = DONE;
    bins.row = 3 * sizeof(int32_t);
    values.row = 3 * sizeof(double);
    worst.row = (6 + (size_t)session->dimension) * sizeof(double);
    for (size_t i = 0; how == DONE && i < count; ++i) {
        how = tell_bin(session, &asked[i], i, &bins, &values);
    }
    for (int64_t i = 0; i < part->worst_cells; ++i) {
        append(&worst, part->worst[i]);
    }
    *judge = session_request(session, "JUDGE", "JUDGED");
    add_integer(judge, "step", session->step + 1);
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
        judge->arrays[i] = make_block(NAMES[i], tables[i]->data, tables[i]->rows, tables[i]->row / width, width);
        judge->arrays[i].is_float = i > 0;
        judge->arrays[i].owned = tables[i]->data;
        how = how == DONE && tables[i]->failed ? no_memory(session->context) : how;
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
        return fail(context, "INTERNAL", "", "the server asks for a bin of %d divisions", to->divisions);
    }
    for (int i = 0; i < to->divisions; ++i) {
        for (int k = 0; k < 3; ++k) {
            snprintf(path, sizeof path, "questions.%zu.way.%d.%d", number, i, k);
            to->way[i][k] = mm_report_number(report, path);
        }
    }
    return DONE;
}

/* The region of cells that CORRECT is to tell. */
typedef struct {
    char metric[32];
    double below;
    int64_t rings;
} extent;

/* Of a reply; whether there is one. */
static int read_extent(const mm_report *report, extent *to)
{
    mm_report_text(report, "region.metric", to->metric, sizeof to->metric);
    to->below = mm_report_number(report, "region.below");
    to->rings = mm_report_integer(report, "region.rings", 0);
    return !isnan(to->below);
}

/* Judge the cells with the nodes displaced, and tell of them until the server asks for nothing more. */
static outcome judge_trial(mm_session *session, const char *metric, const double *displacement, extent *region,
                           int *is_bad)
{
    mm_context *context = session->context;
    mesh_motion_part part;
    int result = mmv_judge(session->volume, displacement, metric, &part);
    question *asked = calloc(MOST_QUESTIONS, sizeof *asked);
    size_t count = 0;
    outcome how = result != MESH_MOTION_OK ? kernels_failed(session, result) : asked ? DONE : no_memory(context);
    for (; how == DONE && count < (size_t)part.metrics; ++count) {
        snprintf(asked[count].metric, sizeof asked[count].metric, "%s", part.names[count]);
    }
    for (int is_over = 0; how == DONE && !is_over;) {
        answer judged = {0};
        request judge = {0};
        how = make_judge(session, &part, asked, count, &judge);
        if (how == DONE) {
            how = deliver_told(session, &judge, is_answered, &judged);
        } else {
            free_told(&judge);
        }
        size_t further = how == DONE ? mm_report_count(&judged.reply.report, "questions") : 0;
        if (count + further > MOST_QUESTIONS) {
            how = fail(context, "INTERNAL", "", "the server asks %zu questions", count + further);
        }
        for (size_t i = 0; how == DONE && i < further; ++i) {
            how = read_question(context, &judged.reply.report, i, &asked[count++]);
        }
        if (how == DONE && !further) {
            *is_bad = read_extent(&judged.reply.report, region);
            keep_report(&session->moved, &judged);
            is_over = 1;
        }
        free_answer(&judged);
    }
    free(asked);
    return how;
}

static void put_numbered(mmi_writer *out, const char *key, int64_t value)
{
    mmi_put_text(out, key);
    mmi_put_integer(out, value);
}

/* An array of a request's own. */
static void *own_array(request *to, int place, const char *name, size_t rows, size_t columns, size_t width)
{
    void *data = malloc(rows * columns * width + 1);
    to->arrays[place] = make_block(name, data, rows, columns, width);
    to->arrays[place].is_float = place == 1 || place == 2;
    to->arrays[place].owned = data;
    return data;
}

/* The CORRECT that tells of a region. */
static outcome make_correct(mm_session *session, const char *what, const extent *asked,
                            const mesh_motion_region *region, const double *positions, request *correct)
{
    size_t d = (size_t)session->dimension, nodes = (size_t)region->nodes, uploaded, types = 0;
    mmi_writer *out = &correct->fields;
    *correct = session_request(session, "CORRECT", "CORRECTED");
    add_integer(correct, "step", session->step + 1);
    add_text(correct, "what", what);
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
    int64_t *told = own_array(correct, 0, "nodes", nodes, 2, sizeof *told);
    double *points = own_array(correct, 1, "points", nodes, d, sizeof *points);
    double *there = own_array(correct, 2, "positions", nodes, d, sizeof *there);
    int32_t *corners = own_array(correct, 3, "corners", (size_t)region->corners, 1, sizeof *corners);
    if (!told || !points || !there || !corners) {
        return no_memory(session->context);
    }
    for (size_t i = 0; i < nodes; ++i) {
        size_t node = (size_t)region->indices[i];
        told[2 * i] = mmv_id_of(session->volume, region->indices[i]);
        told[2 * i + 1] = region->whole[i];
        memcpy(points + i * d, mmv_points(session->volume) + node * d, d * sizeof *points);
        memcpy(there + i * d, positions + node * d, d * sizeof *there);
    }
    for (int64_t i = 0; i < region->corners; ++i) {
        corners[i] = (int32_t)region->rows[i];
    }
    return DONE;
}

/* The nodes and displacements of CORRECTED; nodes by their numbers in the whole mesh. */
static outcome read_corrected(mm_session *session, const answer *from, freed *to)
{
    const mmi_array *nodes = mmi_find_array(&from->reply, "nodes");
    const mmi_array *rows = mmi_find_array(&from->reply, "displacement");
    if (rows->rows && (rows->rows != nodes->rows || rows->columns != (size_t)session->dimension)) {
        return fail(session->context, "INTERNAL", "", "the server's correction does not fit together");
    }
    size_t told;
    to->count = nodes->rows;
    to->nodes = malloc((nodes->rows + 1) * sizeof *to->nodes);
    if (!to->nodes || copy_array(session->context, from, "displacement", &to->displacement, &told) != DONE) {
        return no_memory(session->context);
    }
    copy_integers(to->nodes, from, nodes);
    return DONE;
}

/* Tell of the bad cells and those about them until the server has corrected them. */
static outcome correct(mm_session *session, const char *what, const double *known, extent asked, freed *found)
{
    outcome how = DONE;
    freed around = {0};
    for (int is_over = 0; how == DONE && !is_over;) {
        const mesh_motion_region *region = NULL;
        const double *positions;
        answer corrected = {0};
        request made = {0};
        int result = mmv_region(session->volume, known, asked.metric, asked.below, asked.rings, around.count,
                                around.nodes, &region, &positions);
        how = result == MESH_MOTION_OK ? make_correct(session, what, &asked, region, positions, &made)
                                       : kernels_failed(session, result);
        mesh_motion_region_free(region);
        free_freed(&around);
        if (how == DONE) {
            int is_trial = strcmp(what, "trial") == 0;
            how = deliver_told(session, &made, is_trial ? is_corrected : is_never_kept, &corrected);
        } else {
            free_told(&made);
        }
        how = how == DONE ? read_corrected(session, &corrected, &around) : how;
        is_over = how == DONE && !read_extent(&corrected.reply.report, &asked);
        free_answer(&corrected);
    }
    if (how == DONE) {
        int64_t *nodes = malloc((around.count + 1) * sizeof *nodes);
        int result = nodes ? mmv_find(session->volume, around.count, around.nodes, nodes) : MESH_MOTION_OUT_OF_MEMORY;
        how = result == MESH_MOTION_OK ? DONE : no_memory(session->context);
        free(around.nodes);
        around.nodes = nodes;
        free_freed(found);
        *found = around;
        found->step = session->step + (strcmp(what, "trial") == 0);
        around = (freed){0};
    }
    free_freed(&around);
    return how;
}

/* Put the freed nodes that are here, from base (nodes, dimension) or, without one, as displacement. */
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

/* All nodes by the field that MOVED carries, then all cells; those that are bad are corrected, and judged again. */
static outcome take_trial(mm_session *session, const answer *moved, double *to)
{
    char metric[32];
    double *known = NULL;
    extent region = {0};
    int is_bad = 0;
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

/* All coordinates, by the field that FETCHED carries. */
static outcome take_points(mm_session *session, const answer *fetched, double *points)
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
    if (how == DONE && read_extent(&fetched->reply.report, &region)) {
        if (!session->committed_freed.nodes || session->committed_freed.step != session->step) { /* it was resumed */
            for (size_t row = 0; row < count * d; ++row) {
                known[row] -= at_rest[(size_t)nodes[row / d] * d + row % d];
            }
            how = correct(session, "committed", known, region, &session->committed_freed);
        }
        if (how == DONE) {
            put_freed(session, &session->committed_freed, at_rest, points);
        }
    }
    free(known);
    return how;
}

/* The mesh that was given anew is that of the session. */
static outcome check_reference(mm_session *session)
{
    size_t count, d = (size_t)session->dimension;
    const int64_t *nodes = mmv_uploaded(session->volume, &count);
    answer fetched = {0};
    double *rows = NULL;
    request fetch = session_request(session, "FETCH", "FETCHED");
    add_text(&fetch, "what", "reference");
    outcome how = deliver(session, &fetch, session->context->timeout, &fetched);
    how = how == DONE ? take_uploaded(session, &fetched, "points", &rows) : how;
    for (size_t row = 0; how == DONE && row < count; ++row) {
        if (memcmp(rows + row * d, mmv_points(session->volume) + (size_t)nodes[row] * d, d * sizeof *rows) != 0) {
            how = fail(session->context, "INVALID_ARGUMENT",
                       "give the same points, cells and patches in the same order",
                       "the mesh is not the one that this session was opened with");
        }
    }
    free(rows);
    free_answer(&fetched);
    return how;
}

/* Whether MOVED may leave out all of the field but its coefficients. */
static int knows_field(const mm_session *session) { return session->evaluates && mmv_knows_field(session->volume); }

/* A node as numbered in the mesh, not in what was uploaded of it; -1: there is none. */
static int64_t in_mesh(const mm_session *session, int64_t node)
{
    size_t count;
    const int64_t *nodes = mmv_uploaded(session->volume, &count);
    return node >= 0 && (uint64_t)node < count ? nodes[node] : -1;
}

#else

static outcome not_built_in(const mm_session *session)
{
    return fail(session->context, "UNIMPLEMENTED", "build it with the compiled kernels",
                "this client was built without evaluation by the client");
}
static outcome make_volume(mm_session *session) { return session->evaluates ? not_built_in(session) : DONE; }
static outcome gather_blocks(mm_session *session) { return not_built_in(session); }
static outcome check_reference(mm_session *session) { return not_built_in(session); }
static outcome take_trial(mm_session *session, const answer *moved, double *to)
{
    (void)moved, (void)to;
    return not_built_in(session);
}
static outcome take_points(mm_session *session, const answer *fetched, double *points)
{
    (void)fetched, (void)points;
    return not_built_in(session);
}
static int64_t in_mesh(const mm_session *session, int64_t node)
{
    (void)session;
    return node;
}
static int knows_field(const mm_session *session)
{
    (void)session;
    return 0;
}
static void forget_told(mm_session *session) { (void)session; }
static void keep_freed(mm_session *session) { (void)session; }
static void forget_volume(mm_session *session) { (void)session; }

#endif

/* --- opening
 * ---------------------------------------------------------------------------------------------------------- */

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

/* It is not built, or not any more. */
static void forget_moving_nodes(mm_session *session)
{
    free(session->moving);
    session->moving = NULL;
    session->moving_count = 0;
}

/* The moving nodes as the server has them; they index the caller's arrays, so they are looked at. */
static outcome take_moving_nodes(mm_session *session, const answer *from)
{
    mm_context *context = session->context;
    const mmi_array *array = mmi_find_array(&from->reply, "moving_nodes");
    if (!array) {
        forget_moving_nodes(session);
        return DONE;
    }
    int64_t *moving = malloc((array->rows + 1) * sizeof *moving);
    /* three coordinates a node at most */
    double *trial = malloc((3 * array->rows + 1) * sizeof *trial);
    if (!moving || !trial) {
        free(moving);
        free(trial);
        return no_memory(context);
    }
    copy_integers(moving, from, array);
    for (size_t i = 0; session->volume && i < array->rows; ++i) {
        moving[i] = in_mesh(session, moving[i]);
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
            return fail(context, "INTERNAL", "", "the server's moving nodes are not nodes of this mesh, ascending");
        }
    }
    return DONE;
}

/* Join by OPENED, RESUMED or PROBED, and take over what JOINED tells. */
static outcome join_by(mm_session *session, const answer *from, double deadline)
{
    mm_context *context = session->context;
    char endpoint[ENDPOINT_BYTES];
    answer joined = {0};
    data_endpoint(context, from, endpoint, sizeof endpoint);
    outcome how = join_worker(session, endpoint, integer_field(from, "epoch"), seconds_left(deadline), &joined);
    if (how == DONE) {
        int64_t dimension = integer_field(&joined, "dimension"), nodes = integer_field(&joined, "nodes");
        mm_report_text(&joined.reply.report, "state", session->state, sizeof session->state);
        session->iteration = integer_field(&joined, "iteration");
        session->joined = 1;
        if (dimension >= 1 && dimension <= 3) {
            session->dimension = (int)dimension;
        }
        session->evaluates = mmi_is_text(&joined.reply.report, field(&joined, "evaluation"), "client");
        if (nodes > 0 && !session->evaluates) {
            session->nodes = (size_t)nodes;
        }
        if (session->evaluates && mmi_find_array(&joined.reply, "moving_nodes")) { /* it is built */
            how = make_volume(session);
            free_blocks(session);
        }
        session->may_resume =
            mmi_find_array(&joined.reply, "moving_nodes") && integer_field(&joined, "partitions") == 1;
        how = how == DONE ? take_moving_nodes(session, &joined) : how;
        how = how == DONE ? take_step(session, integer_field(&joined, "step")) : how;
    }
    free_answer(&joined);
    return how;
}

static size_t mesh_bytes(const mm_session *session)
{
    size_t bytes = 0;
    for (size_t i = 0; i < session->block_count; ++i) {
        bytes += array_bytes(&session->blocks[i]);
    }
    return bytes;
}

static outcome open_session(mm_session *session, double deadline)
{
    mm_context *context = session->context;
    answer opened = {0};
    request ask_open = new_request("OPEN", "OPENED");
    add_integer(&ask_open, "dimension", session->dimension);
    add_integer(&ask_open, "partitions", session->partitions);
    add_settings(&ask_open, session);
    add_text(&ask_open, "label", session->label);
    int64_t reserved = session->partitions == 1 && !session->evaluates ? (int64_t)mesh_bytes(session) : 0;
    add_integer(&ask_open, "bytes_reserved", reserved);
    if (session->evaluates) {
        add_text(&ask_open, "evaluation", "client");
    }
    add_text(&ask_open, "durability", session->durability);
    session->may_resume = session->joined = session->has_trial = 0;
    session->part = session->part_row = 0;
    session->step = session->durable_step = 0;
    forget_moving_nodes(session);
    outcome how = ask(context, &session->opening, &ask_open, seconds_left(deadline), &opened);
    if (how == DONE
        && mm_report_text(&opened.reply.report, "session", session->id, sizeof session->id) != MM_ID_SIZE - 1) {
        how = fail(context, "INTERNAL", "", "the server's session has an id that is not of 32 characters");
    }
    if (how == DONE) {
        const mm_report *report = &opened.reply.report;
        memcpy(session->token, report->bytes + report->nodes[field(&opened, "token")].u.offset, MM_TOKEN_BYTES);
        how = join_by(session, &opened, deadline);
    }
    free_answer(&opened);
    return how;
}

/* Again and again while nobody can answer: a session of which nothing is uploaded costs nothing. */
static outcome open_patiently(mm_session *session)
{
    const mm_context *context = session->context;
    double start = context->compute_timeout < START_SECONDS ? context->compute_timeout : START_SECONDS;
    double deadline = now() + (start > context->timeout ? start : context->timeout);
    outcome how = FAILED;
    for (int attempt = 0; attempt < OPEN_ATTEMPTS; ++attempt) {
        mm_clear_error(session->context);
        how = open_session(session, deadline);
        if (how == DONE || context->error != MM_UNAVAILABLE || seconds_left(deadline) <= PAUSE_SECONDS) {
            break;
        }
    }
    return how;
}

mm_result mm_open(mm_session *session)
{
    BEGIN_UNOPENED(session);
    if (!session->dimension) {
        return invalid(session->context, "mm_points must be called before mm_open%s", "");
    }
    if (check_has_server(session->context) == DONE) {
        open_patiently(session);
    }
    return session->context->error;
}

static outcome check_has_credentials(mm_session *session)
{
    if (check_has_server(session->context) != DONE) {
        return FAILED;
    }
    return session->id[0] ? DONE
                          : fail(session->context, "FAILED_PRECONDITION", "mm_set_credentials or mm_load_credentials",
                                 "there is no session to take up");
}

mm_result mm_join(mm_session *session)
{
    BEGIN_SESSION(session);
    mm_context *context = session->context;
    double deadline = now() + context->timeout;
    answer probed = {0};
    outcome how = check_has_credentials(session);
    while (how == DONE) {
        how = probe(session, seconds_left(deadline), &probed);
        if (how != DONE || mmi_is_text(&probed.reply.report, field(&probed, "worker"), "alive")) {
            break;
        }
        if (seconds_left(deadline) <= PAUSE_SECONDS) {
            how = fail(context, "UNAVAILABLE.WORKER", "resume the session from one partition first",
                       "the session has no worker");
        } else {
            pause_for(PAUSE_SECONDS / 4);
        }
    }
    if (how == DONE) {
        session->has_trial = 0;
        how = join_by(session, &probed, deadline);
    }
    if (how == DONE && session->volume) {
        check_reference(session);
    }
    free_answer(&probed);
    return context->error;
}

mm_result mm_resume(mm_session *session)
{
    BEGIN_SESSION(session);
    answer resumed = {0};
    double deadline = now() + session->context->compute_timeout;
    if (check_has_credentials(session) == DONE && resume(session, seconds_left(deadline), &resumed) == DONE) {
        session->has_trial = 0;
        session->durable_step = integer_field(&resumed, "step"); /* SPEC 21.3 */
        if (join_by(session, &resumed, deadline) == DONE && session->volume) {
            check_reference(session);
        }
    }
    free_answer(&resumed);
    return session->context->error;
}

/* Numbers are finite, indices are those of nodes: a fault here is told with its row, before anything is sent. */
static outcome check_rows(mm_context *context, const block *rows, size_t nodes, const char *what)
{
    size_t count = rows->rows * rows->columns;
    for (size_t i = 0; i < count; ++i) {
        int64_t index = 0;
        if (rows->is_float) {
            double value = ((const double *)rows->data)[i];
            if (!isfinite(value)) {
                return fail(context, "INVALID_ARGUMENT.NONFINITE", "look at the solver that sent it first",
                            "%s must be finite, got %g in row %zu", what, value, i / rows->columns);
            }
        } else {
            index = rows->width == 8 ? ((const int64_t *)rows->data)[i] : ((const int32_t *)rows->data)[i];
        }
        if (index < 0 || (uint64_t)index >= nodes) {
            return fail(context, "INVALID_ARGUMENT", "node numbers count from 0",
                        "%s must name nodes 0 ... %zu, got %" PRId64 " in row %zu", what, nodes - 1, index,
                        i / rows->columns);
        }
    }
    return DONE;
}

static outcome check_mesh(mm_session *session)
{
    int has_ids = 0;
    for (size_t i = 0; i < session->block_count; ++i) {
        const block *part = &session->blocks[i];
        int is_ids = strcmp(part->item, "global_ids") == 0;
        char what[NAME_BYTES + 32];
        has_ids = has_ids || is_ids;
        snprintf(what, sizeof what, "%s %s", part->item, part->name);
        if (!is_ids && check_rows(session->context, part, session->nodes, what) != DONE) {
            return FAILED;
        }
    }
    if (session->partitions > 1 && !has_ids) {
        return fail(session->context, "INVALID_ARGUMENT.PARTITION", "mm_global_ids",
                    "with several partitions a mesh must have global ids");
    }
    return DONE;
}

/* From where the last call got to: an UPLOAD that was given up unanswered is the first one to be sent again. */
static outcome upload(mm_session *session)
{
    outcome how = DONE;
    answer uploaded = {0};
    while (how == DONE && session->part < session->block_count) {
        block rows = session->blocks[session->part];
        /* 8 bytes each once they have arrived */
        size_t most = rows.columns ? PART_BYTES / (8 * rows.columns) : rows.rows;
        size_t left = rows.rows - session->part_row;
        request part = session_request(session, "UPLOAD", "UPLOADED");
        add_text(&part, "item", rows.item);
        add_text(&part, "name", rows.name);
        add_text(&part, "role", rows.role);
        block *sent = &part.arrays[0];
        *sent = rows;
        sent->item = "rows";
        sent->rows = left < most ? left : most;
        sent->data = rows.data ? (const uint8_t *)rows.data + session->part_row * rows.columns * rows.width : NULL;
        how = deliver(session, &part, session->context->timeout, &uploaded);
        if (how == DONE) {
            session->part_row += sent->rows;
            if (session->part_row >= rows.rows) {
                ++session->part;
                session->part_row = 0;
            }
        }
        free_answer(&uploaded);
    }
    return how;
}

static outcome build(mm_session *session)
{
    answer built = {0};
    request ask_build = session_request(session, "BUILD", "BUILT");
    outcome how = deliver(session, &ask_build, session->context->compute_timeout, &built);
    if (how == DONE) {
        how = take_moving_nodes(session, &built);
    }
    if (how == DONE) {
        session->step = session->durable_step = session->iteration = 0;
        session->may_resume = session->partitions == 1;
        free_blocks(session); /* the caller's arrays may be gone from now on */
        snprintf(session->state, sizeof session->state, "READY");
        keep_report(&session->built, &built);
    }
    free_answer(&built);
    return how;
}

/* A mesh that was refused is of no use where it is; the error of the call stays that of the refusal. */
static void discard_quietly(mm_session *session)
{
    mm_context *context = session->context;
    mm_result error = context->error;
    told kept = context->told;
    answer closed = {0};
    request close = session_request(session, "CLOSE", "CLOSED");
    add_text(&close, "outcome", "discard");
    context->told.details = (mm_report){0};
    deliver(session, &close, PROBE_SECONDS, &closed);
    free_answer(&closed);
    disconnect(&session->data);
    session->joined = 0;
    mm_clear_error(context);
    context->error = error;
    context->told = kept;
}

static outcome check_joined(mm_session *session)
{
    return session->joined ? DONE
                           : fail(session->context, "FAILED_PRECONDITION.STATE", "mm_open, mm_join or mm_resume first",
                                  "the session is not open");
}

mm_result mm_build(mm_session *session)
{
    BEGIN_SESSION(session);
    mm_context *context = session->context;
    if (check_joined(session) == DONE && session->moving) {
        /* the server would say so too; but what it refuses here is discarded, and this is somebody's work */
        fail(context, "FAILED_PRECONDITION.STATE", "", "the session is built already");
    }
    if (context->error || check_mesh(session) != DONE) {
        return context->error;
    }
    outcome how = FAILED;
    if (session->evaluates && (make_volume(session) != DONE || gather_blocks(session) != DONE)) {
        return context->error;
    }
    for (int attempt = 1;; ++attempt) {
        how = upload(session);
        how = how == DONE ? build(session) : how;
        /* SPEC 11.6: a session that was not built is gone with its worker, another one is opened */
        int is_gone = context->error == MM_UNAVAILABLE || context->error == MM_NOT_FOUND;
        if (!is_gone || session->partitions > 1 || attempt == OPEN_ATTEMPTS) {
            break;
        }
        if (open_patiently(session) != DONE) {
            break;
        }
    }
    if (how != DONE && session->partitions == 1 && session->joined && !is_unheard(context)) {
        discard_quietly(session);
    }
    return context->error;
}

const char *mm_id(const mm_session *session) { return session ? session->id : ""; }
const uint8_t *mm_token(const mm_session *session) { return session ? session->token : NULL; }

mm_result mm_set_credentials(mm_session *session, const char *id, const uint8_t token[MM_TOKEN_BYTES])
{
    BEGIN_SESSION(session);
    if (!id || strlen(id) != MM_ID_SIZE - 1 || !token) {
        return invalid(session->context, "a session's id has 32 characters, and there must be its token%s", "");
    }
    if (strcmp(session->id, id) != 0) { /* what is known of the one before says nothing of this one */
        disconnect(&session->data);
        forget_told(session);
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
        fail(session->context, "FAILED_PRECONDITION.STATE", "mm_open first", "there is no session to save");
        return session->context->error;
    }
    char part[4096], text[160];
    int used = snprintf(text, sizeof text, "{\"session\": \"%s\", \"token\": \"", session->id);
    for (size_t i = 0; i < MM_TOKEN_BYTES; ++i) {
        used += snprintf(text + used, sizeof text - (size_t)used, "%02x", session->token[i]);
    }
    used += snprintf(text + used, sizeof text - (size_t)used, "\"}\n");
    /* into another file first: one that is cut short would lose the session */
    int length = path ? snprintf(part, sizeof part, "%s.part", path) : -1;
    if (length < 0 || (size_t)length >= sizeof part) {
        return invalid(session->context, "the credentials need a path%s", "");
    }
    /* a new one: what is left of an earlier try, or put there by somebody else, has a mode and an owner of its own */
    unlink(part);
    int file = open(part, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
    int written = file >= 0 && write(file, text, (size_t)used) == (ssize_t)used && fsync(file) == 0;
    written = file >= 0 && close(file) == 0 && written;
    if (!written || rename(part, path) != 0) {
        fail(session->context, "INVALID_ARGUMENT", "", "%s: cannot be written: %s", path, strerror(errno));
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
        return invalid(session->context, "%s must hold a session and a token", path ? path : "the credentials");
    }
    for (size_t i = 0; i < MM_TOKEN_BYTES; ++i) {
        unsigned byte = 0;
        sscanf(hex + 2 * i, "%2x", &byte);
        token[i] = (uint8_t)byte;
    }
    return mm_set_credentials(session, id, token);
}

/* --- a time step
 * ------------------------------------------------------------------------------------------------------- */

static outcome check_move(mm_session *session, size_t moving, const double *displacement, size_t nodes,
                          const double *to)
{
    mm_context *context = session->context;
    if (check_joined(session) != DONE) {
        return FAILED;
    }
    if (!session->dimension || !session->moving) {
        return fail(context, "FAILED_PRECONDITION.STATE", "mm_build first", "the session is not built");
    }
    if (moving != session->moving_count || (session->nodes && nodes != session->nodes)) {
        return fail(context, "INVALID_ARGUMENT.SHAPE", "mm_moving_nodes and mm_node_count tell them",
                    "the displacement must have %zu rows and the answer %zu, got %zu and %zu", session->moving_count,
                    session->nodes, moving, nodes);
    }
    if ((moving && !displacement) || (nodes && !to)) {
        return fail(context, "INVALID_ARGUMENT", "", "the displacement and the answer must be there");
    }
    block rows = make_block("displacement", displacement, moving, (size_t)session->dimension, 8);
    rows.is_float = 1;
    return check_rows(context, &rows, moving + 1, "the displacement");
}

/* Rows for all nodes of the partition, from a reply into the caller's array. */
static outcome take_rows(mm_session *session, const answer *from, const char *name, size_t nodes, double *to)
{
    const mmi_array *array = mmi_find_array(&from->reply, name);
    if (array->rows != nodes || array->columns != (size_t)session->dimension) {
        return fail(session->context, "INTERNAL", "", "the server's %s must have shape (%zu, %d), got (%zu, %zu)", name,
                    nodes, session->dimension, array->rows, array->columns);
    }
    copy_numbers(to, from, array);
    return DONE;
}

static outcome take_enrichment(mm_session *session, const answer *from)
{
    const mmi_array *array = mmi_find_array(&from->reply, "enrichment_points");
    if (array->rows && array->columns != (size_t)session->dimension) {
        return fail(session->context, "INTERNAL", "",
                    "the server's enrichment points must have %d coordinates, got %zu", session->dimension,
                    array->columns);
    }
    double *points = realloc(session->enrichment, (array->rows * array->columns + 1) * sizeof *points);
    if (!points) {
        return no_memory(session->context);
    }
    session->enrichment = points;
    session->enrichment_count = array->rows;
    copy_numbers(points, from, array);
    return DONE;
}

mm_result mm_set_report(mm_session *session, const char *report)
{
    BEGIN_SESSION(session);
    if (!report || strlen(report) >= sizeof session->report) {
        return invalid(session->context, "there is no such report: '%s'", report ? report : "");
    }
    snprintf(session->report, sizeof session->report, "%s", report);
    return MM_OK;
}

mm_result mm_set_compute_limit(mm_session *session, double seconds)
{
    BEGIN_SESSION(session);
    if (!(seconds >= 0 && seconds <= 1e9)) {
        return invalid(session->context, "a limit of computing must be 0 to 1e9 s%s", "");
    }
    session->compute_limit_ms = (int64_t)ceil(1000 * seconds);
    return MM_OK;
}

mm_result mm_move(mm_session *session, mm_frame frame, size_t moving, const double *displacement, size_t nodes,
                  double *to)
{
    BEGIN_SESSION(session);
    if (check_move(session, moving, displacement, nodes, to) != DONE) {
        return session->context->error;
    }
    answer moved = {0};
    request move = move_request(session, frame, displacement);
    if (session->compute_limit_ms) {
        add_integer(&move, "compute_limit_ms", session->compute_limit_ms);
    }
    if (knows_field(session)) {
        add_flag(&move, "field_known", 1);
    }
    outcome how = deliver(session, &move, session->context->compute_timeout, &moved);
    if (how == DONE && !session->evaluates) {
        how = take_rows(session, &moved, "displacement", nodes, to);
    }
    if (how == DONE) {
        how = take_enrichment(session, &moved);
    }
    if (how == DONE) {
        session->iteration = integer_field(&moved, "iteration");
        session->trial_frame = frame;
        session->has_trial = 1;
        forget_told(session);
        if (moving) { /* a rank without moving nodes may have no array */
            memcpy(session->trial, displacement, moving * (size_t)session->dimension * sizeof *displacement);
        }
        snprintf(session->state, sizeof session->state, "TRIAL");
        if (session->evaluates) {
            take_trial(session, &moved, to);
        } else {
            keep_report(&session->moved, &moved);
        }
    }
    free_answer(&moved);
    return session->context->error;
}

mm_result mm_set_final_step(mm_session *session, int64_t step)
{
    BEGIN_SESSION(session);
    if (step < 0) {
        char got[24];
        snprintf(got, sizeof got, "%lld", (long long)step);
        return invalid(session->context, "the final step must be 0 (unknown) or more, got %s", got);
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
    if (check_joined(session) != DONE) {
        return session->context->error;
    }
    answer committed = {0};
    request commit = session_request(session, "COMMIT", "COMMITTED");
    add_integer(&commit, "step", session->step + 1);
    if (session->final_step) {
        add_integer(&commit, "final_step", session->final_step);
    }
    if (deliver(session, &commit, session->context->compute_timeout, &committed) == DONE) {
        const mm_report *report = &committed.reply.report;
        session->step = integer_field(&committed, "step");
        session->durable_step = integer_field(&committed, "durable_step");
        memcpy(session->digest, report->bytes + report->nodes[field(&committed, "digest")].u.offset,
               sizeof session->digest);
        end_step(session);
        keep_freed(session);
        keep_report(&session->committed, &committed);
    }
    free_answer(&committed);
    return session->context->error;
}

mm_result mm_rollback(mm_session *session)
{
    BEGIN_SESSION(session);
    if (check_joined(session) != DONE) {
        return session->context->error;
    }
    answer rolled_back = {0};
    request rollback = session_request(session, "ROLLBACK", "ROLLED_BACK");
    add_integer(&rollback, "step", session->step + 1);
    if (deliver(session, &rollback, session->context->compute_timeout, &rolled_back) == DONE) {
        end_step(session);
    }
    free_answer(&rolled_back);
    return session->context->error;
}

mm_result mm_fetch(mm_session *session, mm_frame which, size_t nodes, double *points)
{
    BEGIN_SESSION(session);
    if (check_joined(session) != DONE) {
        return session->context->error;
    }
    if ((nodes && !points) || (session->nodes && nodes != session->nodes)) {
        fail(session->context, "INVALID_ARGUMENT.SHAPE", "mm_node_count tells it",
             "the points must have %zu rows, got %zu", session->nodes, nodes);
        return session->context->error;
    }
    answer fetched = {0};
    request fetch = session_request(session, "FETCH", "FETCHED");
    add_text(&fetch, "what", which == MM_SINCE_REFERENCE ? "reference" : "committed");
    if (deliver(session, &fetch, session->context->timeout, &fetched) == DONE) {
        if (session->evaluates) {
            take_points(session, &fetched, points);
        } else {
            take_rows(session, &fetched, "points", nodes, points);
        }
    }
    free_answer(&fetched);
    return session->context->error;
}

mm_result mm_status(mm_session *session)
{
    BEGIN_SESSION(session);
    if (check_joined(session) != DONE) {
        return session->context->error;
    }
    answer told = {0};
    request ask_status = session_request(session, "STATUS", "STATUS_REPORT");
    if (deliver(session, &ask_status, session->context->timeout, &told) == DONE) {
        mm_report_text(&told.reply.report, "state", session->state, sizeof session->state);
        session->durable_step = mm_report_integer(&told.reply.report, "durable_step", session->durable_step);
        keep_report(&session->status, &told);
    }
    free_answer(&told);
    return session->context->error;
}

mm_result mm_close(mm_session *session, mm_outcome outcome_wanted)
{
    BEGIN_SESSION(session);
    if (!session->joined) {
        return MM_OK;
    }
    answer closed = {0};
    request close = session_request(session, "CLOSE", "CLOSED");
    add_text(&close, "outcome", outcome_wanted == MM_DISCARD ? "discard" : "keep");
    outcome how = deliver(session, &close, session->context->timeout, &closed);
    /* another holder has it, or it is deleted already: nothing of it is ours to end */
    if (how != DONE
        && (mm_error_is(session->context, "ABORTED.FENCED")
            || (outcome_wanted == MM_DISCARD && mm_error_is(session->context, "NOT_FOUND")))) {
        mm_clear_error(session->context);
        how = DONE;
    }
    if (how == DONE) {
        session->joined = session->may_resume = session->has_trial = 0;
        snprintf(session->state, sizeof session->state, "CLOSED");
        disconnect(&session->data);
    }
    free_answer(&closed);
    return session->context->error;
}

int mm_dimension(const mm_session *session) { return session ? session->dimension : 0; }
size_t mm_node_count(const mm_session *session) { return session ? session->nodes : 0; }
int64_t mm_step(const mm_session *session) { return session ? session->step : 0; }
int64_t mm_durable_step(const mm_session *session) { return session ? session->durable_step : 0; }
int64_t mm_iteration(const mm_session *session) { return session ? session->iteration : 0; }
const char *mm_state(const mm_session *session) { return session ? session->state : ""; }
const uint8_t *mm_digest(const mm_session *session) { return session ? session->digest : NULL; }
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

const double *mm_enrichment_points(const mm_session *session, size_t *count)
{
    if (count) {
        *count = session ? session->enrichment_count : 0;
    }
    return session ? session->enrichment : NULL;
}
