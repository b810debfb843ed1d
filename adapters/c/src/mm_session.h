/* A session: one partition's part of one mesh on the server. */
#ifndef MM_SESSION_H
#define MM_SESSION_H

#include "mm_context.h"

/* If a worker dies during the upload, nothing can be resumed: the session is opened at most this number of times. */
#define OPEN_ATTEMPTS 3
#define MOST_ACCEPTED 3 /* requests of one trial: JUDGE, CORRECT, JUDGE */

typedef struct {
    char key[64], text[64];
    mmi_kind kind;
    int64_t integer;
    double number;
} setting;

/* The correction of a step: the corrected nodes, as numbered here, and their displacement from the reference mesh; and
 * the nodes that were sent for the correction, except those that the server knows. */
typedef struct {
    int64_t step, *nodes, *sent;
    double *displacement;
    size_t count, sent_count;
} freed;

struct mm_session {
    mm_context *context;
    mm_session *next;
    /* how it is opened */
    int dimension, partition, partitions;
    size_t nodes, block_count, block_capacity, setting_count, setting_capacity;
    block *blocks; /* [0] the points, then global ids, cells and patches in the order of the calls */
    setting *settings;
    char label[NAME_BYTES], durability[16], report[16];
    /* where it is */
    char id[MM_ID_SIZE];
    uint8_t token[MM_TOKEN_BYTES];
    int64_t epoch;
    connection data;
    line line;
    unanswered request; /* the unanswered request of the session's own line … */
    unanswered opening; /* … and its OPEN or RESUME, in the context's line: each session may have one */
    int joined;
    int may_resume;        /* it is built and has one partition: this side may resume it when its worker has died */
    size_t part, part_row; /* the next UPLOAD: block and row */
    /* its state */
    char state[16];
    int64_t step, durable_step, iteration, final_step, compute_limit_ms;
    uint8_t digest[32];
    int64_t *moving;
    size_t moving_count;
    int64_t *patch_nodes; /* of the moving patches that `entered` names, one after the other */
    size_t patch_node_count;
    double *enrichment;
    size_t enrichment_count;
    /* times and velocities (section 25) for OPEN, for MOVE, and from the last MOVED */
    double start, time, *velocity, *swept, *boundary_velocity;
    int has_time;
    char time_levels[16], scheme[16], headroom_along[16];
    size_t velocity_count, swept_count;
    int64_t *swept_faces; /* NULL: all of the cells */
    size_t face_count, face_corners;
    /* the MOVE that made the trial; it is sent again when the trial was lost with a worker */
    double *trial;
    int has_trial;
    mm_frame trial_frame;
    /* evaluation = "client": */
    int evaluates;
    struct mmv_volume *volume;
    double reach; /* for the next BUILD: the server has the cells within this distance of the moving walls */
    request accepted[MOST_ACCEPTED]; /* JUDGE and CORRECT of the trial, with their own arrays, to be sent again */
    size_t accepted_count;
    freed trial_freed, committed_freed; /* positions of nodes after the last correction */
    mm_report entered, built, moved, committed, status; /* entered: JOINED */
};

/* Times and velocities: fields of OPEN, and values from MOVED. */
void mmi_add_levels(request *open, const mm_session *session);
outcome mmi_take_velocity(mm_session *session, const answer *from, size_t nodes);
#endif
