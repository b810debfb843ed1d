/* The context: its error, the beginning of every call, and the calls that need only a server. See mesh_motion.h. */
#define _POSIX_C_SOURCE 200809L

#include "mm_context.h"
#include "mm_session.h"

#include <fcntl.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>
#include <zmq.h>

#define AGENT "mesh_motion_c " MM_VERSION

/* --- errors ------------------------------------------------------------------------------------------------------- */

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

outcome mmi_fail(mm_context *context, const char *code, const char *hint, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(context->problem.message, sizeof context->problem.message, format, arguments);
    va_end(arguments);
    snprintf(context->problem.code, sizeof context->problem.code, "%s", code);
    snprintf(context->problem.hint, sizeof context->problem.hint, "%s", hint);
    mmi_report_free(&context->problem.details);
    context->error = category(code);
    return FAILED;
}

outcome mmi_no_memory(mm_context *context)
{
    return mmi_fail(context, "RESOURCE_EXHAUSTED.MEMORY", "free some, or divide the mesh into more partitions",
                    "the client has no memory left");
}

mm_result mm_error(const mm_context *context) { return context ? context->error : MM_INVALID_ARGUMENT; }
const char *mm_error_code(const mm_context *context) { return context && context->error ? context->problem.code : ""; }
const char *mm_error_message(const mm_context *context)
{
    return context && context->error ? context->problem.message : "";
}
const char *mm_error_hint(const mm_context *context) { return context && context->error ? context->problem.hint : ""; }

const mm_report *mm_error_details(const mm_context *context)
{
    return context && context->error ? &context->problem.details : NULL;
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
        mmi_report_free(&context->problem.details);
    }
}

/* --- time --------------------------------------------------------------------------------------------------------- */

double mmi_now(void)
{
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return (double)time.tv_sec + 1e-9 * (double)time.tv_nsec;
}

double mmi_seconds_left(double deadline)
{
    double left = deadline - mmi_now();
    return left > 0.0 ? left : 0.0;
}

void mmi_pause_for(double seconds)
{
    struct timespec time = {(time_t)seconds, (long)(1e9 * (seconds - (double)(time_t)seconds))};
    nanosleep(&time, NULL);
}

/* --- what every call begins with ---------------------------------------------------------------------------------- */

int mmi_is_forked(const mm_context *context) { return context->process != getpid(); }

mm_result mmi_fail_forked(mm_context *context)
{
    mmi_fail(context, "FAILED_PRECONDITION",
             "make a new context in the child, connect, and resume the session by its id and token",
             "a forked child cannot use the connections of its parent (process %ld)", (long)context->process);
    return context->error;
}

void *mmi_one_more(mm_context *context, void *table, size_t count, size_t *capacity, size_t size)
{
    if (count < *capacity) {
        return table;
    }
    size_t larger = *capacity ? 2 * *capacity : 8;
    void *grown = realloc(table, larger * size);
    if (!grown) {
        mmi_no_memory(context);
        return NULL;
    }
    *capacity = larger;
    return grown;
}

mm_result mmi_invalid(mm_context *context, const char *hint, const char *message, const char *got)
{
    mmi_fail(context, "INVALID_ARGUMENT", hint, message, got);
    return context->error;
}

/* Only used if standard error is open: otherwise the program may use its descriptor for another file. */
static void warn_on_standard_error(void *unused, const char *line)
{
    (void)unused;
    fprintf(stderr, "mesh_motion: %s\n", line);
}

/* --- a context ---------------------------------------------------------------------------------------------------- */

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
    mmi_new_line(context, &context->line); /* if it fails, the error is there for the first call */
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
    if (!mmi_is_forked(context)) {
        mmi_disconnect(&context->control);
        zmq_ctx_term(context->zmq);
    }
    mmi_report_free(&context->problem.details);
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
    /* libzmq stores milliseconds in a long; and every call must end */
    if (!(seconds > 0.0 && seconds < 1e6 && compute_seconds > 0.0 && compute_seconds < 1e6)) {
        mmi_fail(context, "INVALID_ARGUMENT", "give seconds; 60 and 1800 are usual",
                 "time-outs must be above 0 and below 1e6 s, got %g and %g", seconds, compute_seconds);
        return context->error;
    }
    context->timeout = seconds;
    context->compute_timeout = compute_seconds;
    return MM_OK;
}

/* --- a server ----------------------------------------------------------------------------------------------------- */

mm_result mm_connect(mm_context *context, const char *endpoint)
{
    BEGIN(context);
    if (!endpoint || strlen(endpoint) >= ENDPOINT_BYTES) {
        mmi_fail(context, "INVALID_ARGUMENT", "`mesh-motion serve` prints its endpoint",
                 "endpoint must be tcp://HOST:PORT or ipc:///path, of at most %d bytes", ENDPOINT_BYTES - 1);
        return context->error;
    }
    if (mmi_keys_of_environment(context) != MM_OK) {
        return context->error;
    }
    mmi_disconnect(&context->control);
    snprintf(context->endpoint, sizeof context->endpoint, "%s", endpoint);
    answer welcome = {0};
    request hello = mmi_new_request("HELLO", "WELCOME");
    mmi_add_text(&hello, "agent", AGENT);
    outcome how = mmi_ask(context, NULL, &hello, context->timeout, &welcome);
    if (how != DONE && (context->error == MM_DEADLINE_EXCEEDED || context->error == MM_UNAVAILABLE)) {
        mmi_fail(context, "UNAVAILABLE",
                 context->secret_key[0]
                     ? "is it running (`mesh-motion serve`), and is the given server key its key?"
                     : "is it running (`mesh-motion serve`), and without --keys?",
                 "no server answers at %s within %g s", endpoint, context->timeout);
    }
    if (how == DONE && mm_report_integer(&welcome.reply.report, "version.0", 0) != 1) {
        how =
            mmi_fail(context, "UNIMPLEMENTED.VERSION", "update the older side", "the server does not speak version 1");
    }
    if (how == DONE) {
        mmi_keep_report(&context->welcome, &welcome);
    } else {
        mmi_disconnect(&context->control);
        context->endpoint[0] = '\0';
    }
    mmi_free_answer(&welcome);
    return context->error;
}

outcome mmi_check_has_server(mm_context *context)
{
    return context->endpoint[0] ? DONE
                                : mmi_fail(context, "UNAVAILABLE", "call mm_connect first", "there is no server");
}

mm_result mm_ping(mm_context *context)
{
    BEGIN(context);
    if (mmi_check_has_server(context) == DONE) {
        answer pong = {0};
        request ping = mmi_new_request("PING", "PONG");
        mmi_ask(context, NULL, &ping, context->timeout, &pong);
        mmi_free_answer(&pong);
    }
    return context->error;
}

const mm_report *mm_welcome(const mm_context *context) { return context ? &context->welcome : NULL; }

mm_result mm_list(mm_context *context, const char *after)
{
    BEGIN(context);
    if (mmi_check_has_server(context) == DONE) {
        answer listed = {0};
        request list = mmi_new_request("LIST", "LISTED");
        mmi_add_text(&list, "after", after ? after : "");
        if (mmi_ask(context, NULL, &list, context->timeout, &listed) == DONE) {
            mmi_keep_report(&context->listed, &listed);
        }
        mmi_free_answer(&listed);
    }
    return context->error;
}

const mm_report *mm_listed(const mm_context *context) { return context ? &context->listed : NULL; }
