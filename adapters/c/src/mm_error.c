/* The error of a call, the time that it has, and the code with which every call begins. See mesh_motion.h. */
#define _POSIX_C_SOURCE 200809L

#include "mm_context.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

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

outcome mmi_check_has_server(mm_context *context)
{
    return context->endpoint[0] ? DONE
                                : mmi_fail(context, "UNAVAILABLE", "call mm_connect first", "there is no server");
}
