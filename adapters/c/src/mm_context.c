/* The context, and the calls that need only a server. See mesh_motion.h. */
#define _POSIX_C_SOURCE 200809L

#include "mm_context.h"
#include "mm_session.h"

#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <zmq.h>

#define AGENT "mesh_motion_c " MM_VERSION

/* Do not call it if standard error is closed: the program may use its descriptor for another file. */
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
