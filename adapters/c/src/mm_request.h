/* Requests that the server executes once, although connections break and workers die. */
#ifndef MM_REQUEST_H
#define MM_REQUEST_H

#include "mm_connection.h"
#include "mm_wire.h"

#include <zmq.h>

#define NAME_BYTES 257    /* the limit of SPEC.md for names and labels, and the zero byte */
#define MOST_ARRAYS 4     /* of one request, CORRECT */
#define PROBE_SECONDS 2.0 /* for a PROBE while a request is computed; if only the control endpoint is silent, go on */
#define PAUSE_SECONDS 0.2 /* pause between two attempts while the server cannot answer */

/* Numbered requests: one line for the control endpoint, one for each session. */
typedef struct {
    uint8_t client[MMI_CLIENT_BYTES];
    int64_t sequence;
} line;

/* A request that was given up without an answer: its number, 0 = none, and the hash of its content. */
typedef struct {
    int64_t number;
    uint64_t content;
} unanswered;

/* Rows of the mesh that are uploaded under one item and name. */
typedef struct {
    const char *item;
    char name[NAME_BYTES], role[16];
    const void *data;
    size_t rows, columns, width;
    int is_float, is_list; /* a list has one axis, and one column */
    void *owned; /* the data, where the library has allocated them */
} block;

typedef struct {
    const char *type, *reply;
    int64_t sequence, epoch; /* epoch: -1 where the request has none */
    const uint8_t *client;
    mmi_writer fields; /* all parts except the epoch, which may differ in a repeated request */
    size_t field_count;
    block arrays[MOST_ARRAYS]; /* item = its name; NULL: end of the list */
} request;

typedef struct {
    mmi_reply reply;
    zmq_msg_t *frames;
    size_t *sizes;
    size_t count, capacity;
} answer;

/* --- requests ---------------------------------------------------------------------------------------------------- */

/* A random UUID, as SPEC.md demands for each line. */
outcome mmi_new_line(mm_context *context, line *line);
request mmi_new_request(const char *type, const char *reply);
/* A request about the session to its worker. */
request mmi_session_request(const mm_session *session, const char *type, const char *reply);
request mmi_move_request(const mm_session *session, mm_frame frame, const double *rows);
void mmi_add_text(request *request, const char *key, const char *value);
void mmi_add_integer(request *request, const char *key, int64_t value);
void mmi_add_number(request *request, const char *key, double value);
void mmi_add_flag(request *request, const char *key, int value);
block mmi_make_block(const char *item, const void *data, size_t rows, size_t columns, size_t width);
/* Free its fields and the arrays that it owns. */
void mmi_free_request(request *own);
size_t mmi_array_bytes(const block *array);

/* --- replies ----------------------------------------------------------------------------------------------------- */

uint32_t mmi_field(const answer *from, const char *name);
int64_t mmi_integer_field(const answer *from, const char *name);
void mmi_keep_report(mm_report *to, answer *from);
void mmi_take_numbers(double *to, const answer *from, const mmi_array *array);
void mmi_take_integers(int64_t *to, const answer *from, const mmi_array *array);
void mmi_free_answer(answer *from);
/* After an error: no answer came, or none that follows SPEC.md, so the server may have executed the request. */
int mmi_is_unknown(const mm_context *context);

/* --- the control endpoint ---------------------------------------------------------------------------------------- */

/* Send the request repeatedly until it is answered or the time is over, and free it. `opening` remembers an unanswered
 * one; NULL for a request whose reply the server does not keep. */
outcome mmi_ask(mm_context *context, unanswered *opening, request *request, double seconds, answer *got);
outcome mmi_probe(mm_session *session, double seconds, answer *got);
outcome mmi_resume(mm_session *session, double seconds, answer *got);
/* The worker's endpoint. A host that means all addresses is replaced by the host of the control endpoint
 * (SPEC 2.3). */
void mmi_data_endpoint(const mm_context *context, const answer *from, char *to, size_t size);

/* --- the data endpoint ------------------------------------------------------------------------------------------- */

/* FAILED unless the session is open. */
outcome mmi_check_joined(mm_session *session);
/* Connect to the worker and prove the right to the session. The caller frees `got`. */
outcome mmi_join_worker(mm_session *session, const char *endpoint, int64_t epoch, double seconds, answer *got);
/* Set the session's step to that of the server. With durability "relaxed" it may be lower than before a restart (SPEC
 * 21.5). */
outcome mmi_take_step(mm_session *session, int64_t step);
/* Send a request until it is answered, and free it. A request that was given up unanswered keeps its number. */
outcome mmi_deliver(mm_session *session, request *request, double seconds, answer *got);

#endif
