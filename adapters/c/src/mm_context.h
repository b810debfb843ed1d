/* The context: a server, and the error of the calls. */
#ifndef MM_CONTEXT_H
#define MM_CONTEXT_H

#include "mm_request.h"

#include <sys/types.h>

#define KEY_CHARACTERS 40

typedef struct {
    char code[64], message[1024], hint[512];
    mm_report details;
} problem;

struct mm_context {
    mm_result error;
    problem problem;
    void *zmq;
    unsigned monitors; /* number of monitors made so far; it makes their inproc addresses different */
    pid_t process;     /* the process that made the context: no other process may use its sockets */
    mm_warning warning;
    void *warned;                 /* the first argument of warning */
    int is_silent;                /* no server answers, and a warning was given */
    double asked_at, waits_until; /* time of the latest request to the control endpoint; limit of the waiting call */
    double timeout, compute_timeout;
    char secret_key[KEY_CHARACTERS + 1], public_key[KEY_CHARACTERS + 1], server_key[KEY_CHARACTERS + 1];
    char endpoint[ENDPOINT_BYTES];
    connection control;
    line line;
    mm_report welcome, listed;
    mm_session *sessions;
};

/* --- errors ------------------------------------------------------------------------------------------------------ */

/* Set the error of this call, in place of an earlier one. Returns FAILED. */
__attribute__((format(printf, 4, 5))) outcome mmi_fail(mm_context *context, const char *code, const char *hint,
                                                       const char *format, ...);
outcome mmi_no_memory(mm_context *context);
/* INVALID_ARGUMENT; `message` has one %s for `got`. */
mm_result mmi_invalid(mm_context *context, const char *hint, const char *message, const char *got);
outcome mmi_check_has_server(mm_context *context);
/* Room for one more item of `size` bytes in a table that doubles. Without memory it returns NULL and sets the error. */
void *mmi_one_more(mm_context *context, void *table, size_t count, size_t *capacity, size_t size);

/* --- time -------------------------------------------------------------------------------------------------------- */

double mmi_now(void);
double mmi_seconds_left(double deadline);
void mmi_pause_for(double seconds);

/* --- what every call begins with --------------------------------------------------------------------------------- */

int mmi_is_forked(const mm_context *context);
mm_result mmi_fail_forked(mm_context *context);

/* The first error stays, so a call after it does nothing. */
#define BEGIN(context)                                                                                                 \
    do {                                                                                                               \
        if (!(context)) {                                                                                              \
            return MM_INVALID_ARGUMENT;                                                                                \
        }                                                                                                              \
        if ((context)->error) {                                                                                        \
            return (context)->error;                                                                                   \
        }                                                                                                              \
        if (mmi_is_forked(context)) {                                                                                  \
            return mmi_fail_forked(context);                                                                           \
        }                                                                                                              \
    } while (0)
#define BEGIN_SESSION(session)                                                                                         \
    do {                                                                                                               \
        if (!(session)) {                                                                                              \
            return MM_INVALID_ARGUMENT;                                                                                \
        }                                                                                                              \
        BEGIN((session)->context);                                                                                     \
    } while (0)

/* For settings that OPEN sends. */
#define BEGIN_UNOPENED(session)                                                                                        \
    do {                                                                                                               \
        BEGIN_SESSION(session);                                                                                        \
        if ((session)->joined) {                                                                                       \
            mmi_fail((session)->context, "FAILED_PRECONDITION.STATE", "set it before the session is opened",           \
                     "the session is open already");                                                                   \
            return (session)->context->error;                                                                          \
        }                                                                                                              \
    } while (0)

#endif
