/* Client of the mesh-motion server: displacements of a moving boundary in, displacements of all nodes out.
 *
 *     mm_context *server = mm_context_new();
 *     mm_connect(server, "tcp://127.0.0.1:7440");
 *     mm_session *session = mm_session_new(server);
 *     mm_points(session, 2, nodes, points);
 *     mm_cells(session, "quad", cells, quads);
 *     mm_patch(session, "block", "moving", block_nodes, block);
 *     mm_open(session);                                 // a session on the server
 *     mm_build(session);                                // the mesh is there, checked and durable
 *     mm_move(session, MM_SINCE_COMMITTED, k, rows, nodes, displacement);        // once per coupling iteration
 *     mm_commit(session);                               // once per time step
 *     mm_close(session, MM_KEEP);
 *     if (mm_error(server)) fprintf(stderr, "%s\n", mm_error_message(server));   // once, at the end, is enough
 *
 * Errors are sticky, as those of a stream: the first one stays in the context, and every later call returns it at once
 * and does nothing, until mm_clear_error. So a program can check after each call, or after a whole time step.
 *
 * Every call ends within the time-outs of mm_set_timeouts. A call that timed out may be repeated without a change: it
 * is then the same request, and the server executes it once, even if messages were lost. The calls restore broken
 * connections, and resume a session from its journal when its worker has died.
 *
 * A context with all its sessions is used by one thread at a time; several contexts may be used by several threads.
 * A forked child makes a context of its own; calls with that of its parent fail at once. There is no global state. Text
 * is UTF-8 and ends with a zero byte. Nodes count from 0. Arrays are row-major. protocol/SPEC.md defines the words:
 * committed state, trial, patch, role, partition, quality.
 */
#ifndef MESH_MOTION_H
#define MESH_MOTION_H

#include <stddef.h>
#include <stdint.h>

#if defined(__GNUC__)
#define MM_API __attribute__((visibility("default")))
#else
#define MM_API
#endif

#ifdef __cplusplus
extern "C" {
#endif

#define MM_VERSION "1.0.0"

typedef struct mm_context mm_context; /* a server, and the error */
typedef struct mm_session mm_session; /* one partition's part of one mesh on it */
typedef struct mm_report mm_report;   /* a report of the server: numbers and texts by path; NULL is an empty report */

/* Result of a call: MM_OK or the error's canonical name, numbered as in gRPC. mm_error_code has the details. */
typedef enum {
    MM_OK = 0,
    MM_INVALID_ARGUMENT = 3,
    MM_DEADLINE_EXCEEDED = 4,
    MM_NOT_FOUND = 5,
    MM_PERMISSION_DENIED = 7,
    MM_RESOURCE_EXHAUSTED = 8,
    MM_FAILED_PRECONDITION = 9,
    MM_ABORTED = 10,
    MM_UNIMPLEMENTED = 12,
    MM_INTERNAL = 13,
    MM_UNAVAILABLE = 14,
    MM_DATA_LOSS = 15,
    MM_UNAUTHENTICATED = 16
} mm_result;

/* --- a server ---------------------------------------------------------------------------------------------------- */

/* NULL only without memory. */
MM_API mm_context *mm_context_new(void);
/* Frees its sessions too. NULL is admitted. */
MM_API void mm_context_free(mm_context *context);
/* Time-outs in seconds: of small requests (60), and of build, move, commit, rollback and resume (1800). */
MM_API mm_result mm_set_timeouts(mm_context *context, double seconds, double compute_seconds);
/* The library calls this function once, with one line, when no server answers, and then continues to wait: after some
 * two seconds, or after ten when a session is opened or resumed. The function must not call the library with this
 * context. Without mm_set_warning the line goes to standard error; with NULL there is no line. */
typedef void (*mm_warning)(void *data, const char *line);
MM_API mm_result mm_set_warning(mm_context *context, mm_warning warning, void *data);
/* Set the keys for a server that needs keys: the files that `mesh-motion keys` wrote, the client's .secret and the
 * server's .public (or the server's key itself, 40 characters). Without this call MESH_MOTION_KEY and
 * MESH_MOTION_SERVER_KEY name the files.
 */
MM_API mm_result mm_set_keys(mm_context *context, const char *secret_file, const char *server_key);
/* tcp://HOST:PORT or ipc:///path. Waits until the server answers. */
MM_API mm_result mm_connect(mm_context *context, const char *endpoint);
MM_API mm_result mm_ping(mm_context *context);
/* WELCOME: version.0, server, limits.max_sessions, durability.0 … */
MM_API const mm_report *mm_welcome(const mm_context *context);
/* The server's sessions that this key may see, in the order of their ids: those after the id `after` (NULL: from the
 * first on), as many as one reply can hold. While more is 1, mm_list(context, the last id) has the next ones.
 */
MM_API mm_result mm_list(mm_context *context, const char *after);
/* LISTED: sessions.0.session, .label, .state, .step, .partitions, .worker; more */
MM_API const mm_report *mm_listed(const mm_context *context);

/* --- the error --------------------------------------------------------------------------------------------------- */

MM_API mm_result mm_error(const mm_context *context);
MM_API const char *mm_error_code(const mm_context *context);    /* "FAILED_PRECONDITION.QUALITY"; "" without an error */
MM_API const char *mm_error_message(const mm_context *context); /* what was expected, what came */
MM_API const char *mm_error_hint(const mm_context *context);    /* what to do; may be "" */
/* The first offender: node, patch, row, value … With FAILED_PRECONDITION.QUALITY: best, fraction, worst.0.cell … */
MM_API const mm_report *mm_error_details(const mm_context *context);
/* 1 if the code is this one or one of its details: "ABORTED" is also ABORTED.FENCED. */
MM_API int mm_error_is(const mm_context *context, const char *code);
MM_API void mm_clear_error(mm_context *context);

/* --- a mesh and how it is moved ---------------------------------------------------------------------------------- */

MM_API mm_session *mm_session_new(mm_context *context);
/* Ends the connection only: the session stays on the server until its lease ends (mm_close is better). */
MM_API void mm_session_free(mm_session *session);

/* The arrays of these four are not copied: leave them in place until mm_build returns. Indices and types are checked.
 * Cell types: line; triangle, quad; tetra, pyramid, wedge, hexahedron, with their nodes in the order of VTK; but a
 * wedge as in Gmsh: nodes 0, 1, 2 anticlockwise as seen from 3, 4, 5 (SPEC.md, section 13).
 * Roles: moving, fixed, slip, symmetry, periodic. mm_cells may be called once for each type, mm_patch for each patch.
 */
MM_API mm_result mm_points(mm_session *session, int dimension, size_t nodes, const double *points);
MM_API mm_result mm_cells(mm_session *session, const char *type, size_t cells, const int64_t *nodes);
MM_API mm_result mm_cells32(mm_session *session, const char *type, size_t cells, const int32_t *nodes);
MM_API mm_result mm_patch(mm_session *session, const char *name, const char *role, size_t nodes,
                          const int64_t *indices);
/* With several partitions: the number of each node in the whole mesh. */
MM_API mm_result mm_global_ids(mm_session *session, const int64_t *ids);

/* Settings of the method, before mm_open; SPEC.md, section 14, has their names: support_radius, quality_threshold … */
MM_API mm_result mm_set_number(mm_session *session, const char *key, double value);
MM_API mm_result mm_set_integer(mm_session *session, const char *key, int64_t value);
MM_API mm_result mm_set_flag(mm_session *session, const char *key, int value);
MM_API mm_result mm_set_text(mm_session *session, const char *key, const char *value);
/* Shown in logs and lists. */
MM_API mm_result mm_set_label(mm_session *session, const char *label);
/* What mm_commit waits for: "full", "replay" or "relaxed" (SPEC.md, section 21), of those that WELCOME names. With
 * "relaxed" steps after mm_durable_step may be lost; the next call then says ABORTED.STEPS_LOST. */
MM_API mm_result mm_set_durability(mm_session *session, const char *durability);
/* The number of this partition, and the number of partitions (default 0 and 1). A partition is a rank of a parallel
 * driver. */
MM_API mm_result mm_set_partition(mm_session *session, int partition, int partitions);

/* The side that evaluates the motion at the nodes: "server" or "client" (SPEC.md, section 23). With "client" the server
 * has the boundary only; nodes and cells stay here, and mm_move moves and judges them, with the same results. mm_open,
 * mm_build and mm_move refuse settings that need the server. Give such a session its mesh (mm_points and the calls
 * after it) before mm_join and mm_resume. mm_moved then has `quality`, `reached` and `warnings`. UNIMPLEMENTED in a
 * library without the compiled kernels. */
MM_API mm_result mm_set_evaluation(mm_session *session, const char *evaluation);

/* --- opening ----------------------------------------------------------------------------------------------------- */

/* Open a new session and join it. With several partitions one of them opens; its id and token go to the others … */
MM_API mm_result mm_open(mm_session *session);
/* … which join the session with them. Also for a session that another partition has resumed. */
MM_API mm_result mm_join(mm_session *session);
/* Uploads the mesh (or this partition's part) and waits until the whole is checked and durable. Then the
 * library forgets the mesh: to open the session again, call mm_points and the calls after it again. */
MM_API mm_result mm_build(mm_session *session);
/* Resumes a session at its last committed step, after a crash of any side; earlier clients lose the session. */
MM_API mm_result mm_resume(mm_session *session);

#define MM_ID_SIZE 33 /* 32 hexadecimal digits and the end */
#define MM_TOKEN_BYTES 32
/* The credentials of the session. With them any client can resume it, so keep the token secret. */
MM_API const char *mm_id(const mm_session *session);
MM_API const uint8_t *mm_token(const mm_session *session);
MM_API mm_result mm_set_credentials(mm_session *session, const char *id, const uint8_t token[MM_TOKEN_BYTES]);
/* Save and load the credentials in a file of mode 0600, in the format of the Python client. */
MM_API mm_result mm_save_credentials(mm_session *session, const char *path);
MM_API mm_result mm_load_credentials(mm_session *session, const char *path);

/* --- a time step ------------------------------------------------------------------------------------------------- */

/* The state from which a displacement counts: the committed state (increments), or the mesh as it was uploaded (totals,
 * as structural codes have them). */
typedef enum { MM_SINCE_COMMITTED, MM_SINCE_REFERENCE } mm_frame;
typedef enum { MM_KEEP, MM_DISCARD } mm_outcome;

/* One coupling iteration: `moving` rows for the moving nodes (in the order of mm_moving_nodes) in, `nodes` rows for all
 * nodes out. Each iteration starts from the committed state; nothing is final. MM_FAILED_PRECONDITION, code
 * FAILED_PRECONDITION.QUALITY: there is no acceptable mesh; the session does not change. */
MM_API mm_result mm_move(mm_session *session, mm_frame frame, size_t moving, const double *displacement, size_t nodes,
                         double *answer);
/* The derivative of the motion by the positions of the moving nodes, at the open trial, or at the committed state if
 * there is none (SPEC.md, section 24). Both change nothing. `vectors` is the number of vectors in one call: a row has
 * mm_dimension numbers of the first vector, then those of the next. MM_FAILED_PRECONDITION: the method or this mesh has
 * no derivative. Velocities of the moving nodes in, velocities of all nodes out: */
MM_API mm_result mm_tangent(mm_session *session, size_t vectors, size_t moving, const double *velocity, size_t nodes,
                            double *answer);
/* In: weights of all nodes, the derivative of an objective by their positions. Out: weights of the moving nodes. */
MM_API mm_result mm_cotangent(mm_session *session, size_t vectors, size_t nodes, const double *weights, size_t moving,
                              double *answer);
/* The additional report of each move from now on: ""; "faces", face measures of a finite-volume code; "headroom", the
 * number of further steps of this kind that the mesh admits (SPEC.md, section 15); or "swept" for mm_swept. It takes
 * time: set it for the move that is committed, then set "" again. mm_moved then has `faces.after.max_non_orthogonality`
 * …, and with both "headroom" and "faces" `headroom.inversion`, `headroom.threshold`: left out (NaN) above 100. */
MM_API mm_result mm_set_report(mm_session *session, const char *report);
/* The unit of the headroom, from now on: "step"; "displacement", multiples of the whole displacement since the uploaded
 * mesh; or "velocity", seconds of mm_velocity (docs/watching.md). */
MM_API mm_result mm_set_headroom_along(mm_session *session, const char *way);
/* Seconds after which the server gives up computing a move, from now on; 0: never. The move is then refused with
 * MM_DEADLINE_EXCEEDED, and the session does not change. */
MM_API mm_result mm_set_compute_limit(mm_session *session, double seconds);
/* The last step of the run, which each commit sends from now on; 0: unknown. With it the monitor estimates when the run
 * ends. Call it again when the last step changes. */
MM_API mm_result mm_set_final_step(mm_session *session, int64_t step);
/* The last move becomes the committed state, durably, and the time step ends. */
MM_API mm_result mm_commit(mm_session *session);
/* Drop the moves of this time step. */
MM_API mm_result mm_rollback(mm_session *session);
/* Coordinates of all nodes: committed, or of the mesh as it was uploaded. */
MM_API mm_result mm_fetch(mm_session *session, mm_frame which, size_t nodes, double *points);
/* Ask the server for the session's status; mm_state, mm_durable_step and mm_status_report then have the answer. */
MM_API mm_result mm_status(mm_session *session);
/* MM_KEEP leaves the session stored and resumable, MM_DISCARD deletes it. Doing it twice is no error. */
MM_API mm_result mm_close(mm_session *session, mm_outcome outcome);

MM_API int mm_dimension(const mm_session *session);
MM_API size_t mm_node_count(const mm_session *session);
/* The nodes whose displacement mm_move takes, ascending; valid until mm_open, mm_join or mm_resume. */
MM_API const int64_t *mm_moving_nodes(const mm_session *session, size_t *count);
/* The nodes of a moving patch in the order of mm_patch, for a program that has resumed or joined a session without its
 * mesh. NULL if mm_joined does not name the patch; valid until mm_open, mm_join or mm_resume. */
MM_API const int64_t *mm_patch_nodes(const mm_session *session, const char *name, size_t *count);
MM_API int64_t mm_step(const mm_session *session);          /* last committed step; 0: as uploaded */
MM_API int64_t mm_durable_step(const mm_session *session);  /* the step that survives a crash of the machine */
MM_API int64_t mm_iteration(const mm_session *session);     /* moves of the current step */
MM_API const char *mm_state(const mm_session *session);     /* of the last reply: READY, TRIAL … */
MM_API const uint8_t *mm_digest(const mm_session *session); /* 32 bytes: SHA-256 of the committed state */
/* Times, velocities and swept volumes (SPEC.md, section 25; docs/velocities.md). Before mm_open: the time of the mesh as
 * it is uploaded, seconds (0), and the scheme whose earlier levels each commit stores: "" (none), "bdf2" or "bossak". */
MM_API mm_result mm_set_time_levels(mm_session *session, double start, const char *scheme);
/* The time at the end of the current step, for its moves and its commit; set it again for each step. A commit is
 * refused if its time differs from that of its last move. */
MM_API mm_result mm_set_time(mm_session *session, double time);
/* The scheme of the velocities in the answers to moves, from now on: "" (none), "tangent", "bdf1", "bdf2" or
 * "bossak". */
MM_API mm_result mm_set_velocity(mm_session *session, const char *scheme);
/* With the scheme "tangent", and before its moves: `moving` rows, the velocities of the moving nodes. They are copied. */
MM_API mm_result mm_set_boundary_velocity(mm_session *session, size_t moving, const double *velocity);
/* Velocities of all nodes in the last move: `count` rows of mm_dimension components. NULL if none was requested. */
MM_API const double *mm_velocity(const mm_session *session, size_t *count);
/* The faces of the report "swept", from now on: `faces` rows with the `corners` nodes of each face, filled up with -1.
 * In 3D anticlockwise as seen from the side that the normal points to; in 2D an edge has its normal on its right.
 * They are copied. NULL: all faces of the cells, as without this call. */
MM_API mm_result mm_set_swept_faces(mm_session *session, size_t faces, size_t corners, const int64_t *nodes);
/* Volumes that the faces sweep in the last move, with mm_set_report "swept": `count` numbers. Without given faces they
 * are those of the cells' faces, positive outwards, cell after cell, in the order of section 25. NULL if none was
 * requested. */
MM_API const double *mm_swept(const mm_session *session, size_t *count);
/* Points at which the last move added enrichment functions: `count` rows of mm_dimension coordinates. */
MM_API const double *mm_enrichment_points(const mm_session *session, size_t *count);

/* --- reports ----------------------------------------------------------------------------------------------------- */

/* The last replies of each kind (SPEC.md, sections 12 and 15); valid until the next one of that kind. */
MM_API const mm_report *mm_joined(const mm_session *session);    /* moving_patches.0.0, a name, and 0.1, nodes; time … */
MM_API const mm_report *mm_built(const mm_session *session);     /* settings, mesh, quality */
MM_API const mm_report *mm_moved(const mm_session *session);     /* quality, correction, seconds, faces, headroom … */
MM_API const mm_report *mm_committed(const mm_session *session); /* quality, durable_step */
MM_API const mm_report *mm_status_report(const mm_session *session);

/* Values by path: keys and indices with dots, as "quality.corrected.metric.min" or "quality.corrected.worst.0.cell". */
MM_API double mm_report_number(const mm_report *report, const char *path); /* NaN without a number at the path */
MM_API int64_t mm_report_integer(const mm_report *report, const char *path, int64_t otherwise);
MM_API size_t mm_report_count(const mm_report *report, const char *path); /* items of an array or map */
/* Text, cut to the buffer and always ended. Returns its whole length. */
MM_API size_t mm_report_text(const mm_report *report, const char *path, char *buffer, size_t size);
/* The value at a path as JSON; path "" for the whole report. Returns the length of the text, as snprintf does. */
MM_API size_t mm_report_json(const mm_report *report, const char *path, char *buffer, size_t size);

#ifdef __cplusplus
}
#endif

#endif
