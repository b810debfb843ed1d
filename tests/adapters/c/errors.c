/* The errors as a program sees them: errors ENDPOINT. Prints a line for each
 * expectation that is not met. */
#include <mesh_motion.h>

#include <math.h>
#include <stdio.h>
#include <string.h>

static int failures;
#define EXPECT(condition)                                                                                              \
    do {                                                                                                               \
        if (!(condition)) {                                                                                            \
            printf("line %d: %s (%s: %s)\n", __LINE__, #condition, mm_error_code(server), mm_error_message(server));   \
            ++failures;                                                                                                \
        }                                                                                                              \
    } while (0)

/* clear an error, which must say what to do */
#define CLEAR(server)                                                                                                  \
    do {                                                                                                               \
        EXPECT(mm_error(server) == MM_OK || strlen(mm_error_hint(server)) > 0);                                        \
        mm_clear_error(server);                                                                                        \
    } while (0)

/* by as many pages as there are */
static int is_listed(mm_context *server, const char *id)
{
    char name[MM_ID_SIZE] = "", path[64];
    do {
        EXPECT(mm_list(server, name) == MM_OK);
        for (size_t i = 0; i < mm_report_count(mm_listed(server), "sessions"); ++i) {
            snprintf(path, sizeof path, "sessions.%zu.session", i);
            mm_report_text(mm_listed(server), path, name, sizeof name);
            if (strcmp(name, id) == 0) {
                return 1;
            }
        }
    } while (mm_report_integer(mm_listed(server), "more", 0));
    return 0;
}

int main(int count, char **arguments)
{
    double points[] = {0, 0, 1, 0, 1, 1, 0, 1}, answer[8], rows[] = {0.1, 0, 0.1, 0}, wild[] = {0.1, 0, NAN, 0};
    int64_t triangles[] = {0, 1, 2, 0, 2, 3}, wrong[] = {0, 1, 2, 0, 2, 4}, left[] = {0, 3}, right[] = {1, 2};
    mm_context *server = mm_context_new();
    EXPECT(mm_error(server) == MM_OK && strcmp(mm_error_code(server), "") == 0 && mm_error_details(server) == NULL);

    /* no server there: the error comes within the time, and stays until it is cleared */
    mm_set_timeouts(server, 0.3, 0.3);
    EXPECT(mm_connect(server, "tcp://127.0.0.1:9") == MM_UNAVAILABLE);
    EXPECT(strlen(mm_error_hint(server)) > 0);
    EXPECT(mm_connect(server, arguments[count > 1]) == MM_UNAVAILABLE);
    EXPECT(mm_session_new(server) == NULL && mm_open(NULL) == MM_INVALID_ARGUMENT);
    CLEAR(server);
    const char *nowhere[] = {"tcp://", "tcp://a:", "tcp://a:0", "tcp://a:65536", "tcp://a:99999", "tcp://a:7440x",
                             "tcp://a:00007440", "inproc://a", "udp://127.0.0.1:7440", "localhost:7440", "ipc://", ""};
    for (size_t i = 0; i < sizeof nowhere / sizeof *nowhere; ++i) {
        EXPECT(mm_connect(server, nowhere[i]) == MM_INVALID_ARGUMENT);
        CLEAR(server);
    }
    mm_set_timeouts(server, 60, 60);
    EXPECT(mm_connect(server, arguments[count > 1]) == MM_OK && mm_ping(server) == MM_OK);
    EXPECT(mm_report_integer(mm_welcome(server), "limits.max_header_bytes", 0) == 65536);

    /* the error comes before anything is sent */
    mm_session *session = mm_session_new(server);
    EXPECT(mm_open(session) == MM_INVALID_ARGUMENT);
    CLEAR(server);
    EXPECT(mm_save_credentials(session, "none.json") == MM_FAILED_PRECONDITION);
    CLEAR(server);
    EXPECT(mm_move(session, MM_SINCE_COMMITTED, 2, rows, 4, answer) == MM_FAILED_PRECONDITION);
    CLEAR(server);
    mm_points(session, 2, 4, points);
    EXPECT(mm_cells(session, "cube", 2, triangles) == MM_INVALID_ARGUMENT
           && strstr(mm_error_message(server), "'cube'"));
    CLEAR(server);
    EXPECT(mm_patch(session, "left", "sliding", 2, left) == MM_INVALID_ARGUMENT);
    CLEAR(server);
    EXPECT(mm_set_number(session, "support_radius", INFINITY) == MM_INVALID_ARGUMENT);
    CLEAR(server);
    mm_cells(session, "triangle", 2, wrong);
    mm_patch(session, "left", "moving", 2, left);
    mm_patch(session, "right", "fixed", 2, right);
    mm_set_text(session, "no_such_setting", "x");
    EXPECT(mm_open(session) == MM_INVALID_ARGUMENT && mm_error_is(server, "INVALID_ARGUMENT.SETTINGS"));
    EXPECT(mm_error_is(server, "INVALID_ARGUMENT") && !mm_error_is(server, "INVALID_ARGUMENT.SET"));
    EXPECT(mm_report_text(mm_error_details(server), "setting", NULL, 0) == strlen("no_such_setting"));
    CLEAR(server);
    mm_session_free(session);

    session = mm_session_new(server);
    mm_points(session, 2, 4, points);
    mm_cells(session, "triangle", 2, wrong);
    mm_patch(session, "left", "moving", 2, left);
    mm_patch(session, "right", "fixed", 2, right);
    EXPECT(mm_open(session) == MM_OK);
    EXPECT(mm_build(session) == MM_INVALID_ARGUMENT && strstr(mm_error_message(server), "got 4 in row 1"));
    CLEAR(server);
    wrong[5] = 3; /* borrowed, not copied: mended in place */
    EXPECT(mm_build(session) == MM_OK);
    EXPECT(mm_build(session) == MM_FAILED_PRECONDITION && mm_error_is(server, "FAILED_PRECONDITION.STATE"));
    CLEAR(server); /* and the session is what it was */
    EXPECT(mm_status(session) == MM_OK);
    EXPECT(mm_node_count(session) == 4 && mm_dimension(session) == 2 && strcmp(mm_state(session), "READY") == 0);
    EXPECT(mm_move(session, MM_SINCE_COMMITTED, 2, wild, 4, answer) == MM_INVALID_ARGUMENT);
    EXPECT(mm_error_is(server, "INVALID_ARGUMENT.NONFINITE") && strstr(mm_error_message(server), "row 1"));
    CLEAR(server);
    EXPECT(mm_move(session, MM_SINCE_COMMITTED, 3, rows, 4, answer) == MM_INVALID_ARGUMENT);
    CLEAR(server);

    EXPECT(mm_move(session, (mm_frame)2, 2, rows, 4, answer) == MM_INVALID_ARGUMENT && strstr(mm_error_message(server), "got 2"));
    CLEAR(server);
    EXPECT(mm_fetch(session, (mm_frame)-1, 4, answer) == MM_INVALID_ARGUMENT);
    CLEAR(server);

    mm_session *negative = mm_session_new(server);
    EXPECT(mm_points(negative, 2, (size_t)-1, points) == MM_INVALID_ARGUMENT);
    CLEAR(server);
    mm_points(negative, 2, 4, points);
    EXPECT(mm_cells(negative, "triangle", (size_t)-1, triangles) == MM_INVALID_ARGUMENT);
    CLEAR(server);
    mm_session_free(negative);

    /* Latin-1 as in an old source: the server would drop the message, and the client would wait for its time-out */
    mm_session *latin = mm_session_new(server);
    mm_points(latin, 2, 4, points);
    mm_cells(latin, "triangle", 2, triangles);
    mm_patch(latin, "T\xfcr", "moving", 2, left);
    EXPECT(mm_open(latin) == MM_OK && mm_build(latin) == MM_INVALID_ARGUMENT);
    EXPECT(strstr(mm_error_message(server), "a text that is not UTF-8: 'T\xfcr'"));
    CLEAR(server);
    mm_session_free(latin);
    latin = mm_session_new(server);
    mm_points(latin, 2, 4, points);
    mm_set_label(latin, "Fl\xfcgel");
    EXPECT(mm_open(latin) == MM_INVALID_ARGUMENT && strstr(mm_error_message(server), "UTF-8"));
    CLEAR(server);
    mm_session_free(latin);

    /* a motion without an acceptable mesh: the left side beyond the right one */
    double across[] = {3, 0, 3, 0};
    EXPECT(mm_move(session, MM_SINCE_COMMITTED, 2, across, 4, answer) == MM_FAILED_PRECONDITION);
    EXPECT(mm_error_is(server, "FAILED_PRECONDITION.QUALITY"));
    EXPECT(isfinite(mm_report_number(mm_error_details(server), "best")));
    EXPECT(mm_report_count(mm_error_details(server), "worst") > 0);
    EXPECT(mm_commit(session) == MM_FAILED_PRECONDITION); /* sticky: not sent */
    CLEAR(server);
    EXPECT(mm_set_report(session, "edges") == MM_OK);
    EXPECT(mm_move(session, MM_SINCE_COMMITTED, 2, rows, 4, answer) == MM_INVALID_ARGUMENT);
    CLEAR(server);
    EXPECT(mm_set_report(session, "everything there is") == MM_INVALID_ARGUMENT);
    CLEAR(server);
    EXPECT(mm_set_report(session, "faces") == MM_OK);
    EXPECT(mm_move(session, MM_SINCE_COMMITTED, 2, rows, 4, answer) == MM_OK);
    EXPECT(isfinite(mm_report_number(mm_moved(session), "faces.after.max_non_orthogonality")));
    EXPECT(mm_set_report(session, "") == MM_OK && mm_rollback(session) == MM_OK);
    EXPECT(mm_set_compute_limit(session, 60) == MM_OK);
    EXPECT(mm_set_compute_limit(session, -1) == MM_INVALID_ARGUMENT);
    CLEAR(server);
    EXPECT(mm_move(session, MM_SINCE_COMMITTED, 2, rows, 4, answer) == MM_OK && mm_iteration(session) == 1);
    EXPECT(mm_report_count(mm_moved(session), "faces") == 0);
    EXPECT(mm_set_time(session, 0.5) == MM_OK && mm_move(session, MM_SINCE_COMMITTED, 2, rows, 4, answer) == MM_OK);
    EXPECT(mm_set_time(session, 0.7) == MM_OK && mm_commit(session) == MM_INVALID_ARGUMENT); /* at another time */
    EXPECT(strstr(mm_error_message(server), "0.7") && strstr(mm_error_message(server), "0.5"));
    CLEAR(server);
    EXPECT(mm_set_time(session, 0.5) == MM_OK && mm_commit(session) == MM_OK && mm_step(session) == 1);
    EXPECT(mm_set_time_levels(session, 0, "bdf2") == MM_FAILED_PRECONDITION); /* OPEN has sent them */
    CLEAR(server);
    EXPECT(mm_set_time(session, 0.9) == MM_OK);

    /* derivatives of two vectors: the left side has the velocities, the right one rests */
    double two[] = {1, 2, 3, 4, 5, 6, 7, 8}, all[16], back[8];
    EXPECT(mm_tangent(session, 2, 2, two, 4, all) == MM_OK);
    EXPECT(memcmp(all, two, 4 * sizeof *two) == 0 && memcmp(all + 12, two + 4, 4 * sizeof *two) == 0);
    EXPECT(fabs(all[4]) + fabs(all[7]) + fabs(all[8]) + fabs(all[11]) == 0);
    EXPECT(mm_cotangent(session, 2, 4, all, 2, back) == MM_OK && memcmp(back, two, sizeof two) == 0);
    EXPECT(mm_tangent(session, 1, 4, two, 4, all) == MM_INVALID_ARGUMENT);
    EXPECT(mm_error_is(server, "INVALID_ARGUMENT.SHAPE"));
    CLEAR(server);
    EXPECT(mm_tangent(session, 2, 2, two, INT64_MAX, all) == MM_INVALID_ARGUMENT); /* a Fortran array of another shape */
    EXPECT(strstr(mm_error_message(server), "the first dimension of each array must be 2") != NULL);
    CLEAR(server);
    EXPECT(mm_cotangent(session, 0, 4, all, 2, back) == MM_INVALID_ARGUMENT);
    CLEAR(server);
    two[3] = NAN;
    EXPECT(mm_tangent(session, 2, 2, two, 4, all) == MM_INVALID_ARGUMENT);
    EXPECT(mm_error_is(server, "INVALID_ARGUMENT.NONFINITE"));
    CLEAR(server);
    EXPECT(mm_set_boundary_velocity(session, 2, two) == MM_INVALID_ARGUMENT && strstr(mm_error_message(server), "row 1"));
    CLEAR(server);
    EXPECT(mm_set_boundary_velocity(session, 3, two) == MM_INVALID_ARGUMENT && strstr(mm_error_message(server), "got 3"));
    CLEAR(server);
    EXPECT(mm_set_velocity(session, "tangent") == MM_OK); /* without velocities */
    EXPECT(mm_move(session, MM_SINCE_COMMITTED, 2, rows, 4, answer) == MM_INVALID_ARGUMENT);
    CLEAR(server);
    EXPECT(mm_set_velocity(session, "") == MM_OK && mm_set_report(session, "swept") == MM_OK);
    EXPECT(mm_set_swept_faces(session, 1, 0, left) == MM_INVALID_ARGUMENT);
    CLEAR(server);
    int64_t beyond[] = {2, 4};
    EXPECT(mm_set_swept_faces(session, 1, 2, beyond) == MM_OK);
    EXPECT(mm_move(session, MM_SINCE_COMMITTED, 2, rows, 4, answer) == MM_INVALID_ARGUMENT);
    EXPECT(strstr(mm_error_message(server), "column 1 is 4") != NULL);
    CLEAR(server);
    EXPECT(mm_set_swept_faces(session, 0, 0, NULL) == MM_OK && mm_set_report(session, "headroom") == MM_OK);
    EXPECT(mm_set_headroom_along(session, "everywhere at once") == MM_INVALID_ARGUMENT);
    CLEAR(server);
    EXPECT(mm_set_headroom_along(session, "displacement") == MM_OK);
    EXPECT(mm_move(session, MM_SINCE_COMMITTED, 2, rows, 4, answer) == MM_OK);
    EXPECT(isfinite(mm_report_number(mm_moved(session), "headroom.inversion")));
    EXPECT(mm_set_report(session, "") == MM_OK);
    EXPECT(mm_rollback(session) == MM_OK && mm_status(session) == MM_OK && strcmp(mm_state(session), "READY") == 0);
    EXPECT(is_listed(server, mm_id(session)) && !is_listed(server, "00000000000000000000000000000000"));
    EXPECT(mm_list(server, "ffffffffffffffffffffffffffffffff") == MM_OK);
    EXPECT(mm_report_count(mm_listed(server), "sessions") == 0);

    /* fenced: another holder resumes, this one gets the error; its close is no error */
    mm_session *holder = mm_session_new(server);
    mm_set_credentials(holder, mm_id(session), mm_token(session));
    EXPECT(mm_resume(holder) == MM_OK && mm_step(holder) == 1);
    EXPECT(mm_commit(session) == MM_ABORTED && mm_error_is(server, "ABORTED.FENCED"));
    CLEAR(server);
    EXPECT(mm_close(session, MM_KEEP) == MM_OK && mm_close(session, MM_KEEP) == MM_OK);
    EXPECT(mm_fetch(holder, MM_SINCE_REFERENCE, 4, answer) == MM_OK && memcmp(answer, points, sizeof points) == 0);
    EXPECT(mm_close(holder, MM_DISCARD) == MM_OK);
    EXPECT(mm_resume(holder) == MM_NOT_FOUND);

    /* what a commit waits for; a relaxed one is durable a little later */
    session = mm_session_new(server);
    EXPECT(session == NULL && mm_error_is(server, "NOT_FOUND"));
    CLEAR(server);
    session = mm_session_new(server);
    mm_points(session, 2, 4, points);
    mm_cells(session, "triangle", 2, triangles);
    mm_patch(session, "left", "moving", 2, left);
    mm_patch(session, "right", "fixed", 2, right);
    mm_set_durability(session, "sometimes");
    EXPECT(mm_open(session) == MM_INVALID_ARGUMENT);
    CLEAR(server);
    mm_set_durability(session, "relaxed");
    EXPECT(mm_open(session) == MM_OK && mm_set_label(session, "late") == MM_FAILED_PRECONDITION);
    CLEAR(server);
    EXPECT(mm_build(session) == MM_OK && mm_move(session, MM_SINCE_COMMITTED, 2, rows, 4, answer) == MM_OK);
    EXPECT(mm_commit(session) == MM_OK && mm_step(session) == 1 && mm_durable_step(session) <= 1);
    for (int tries = 0; tries < 100000 && mm_durable_step(session) < 1; ++tries) {
        EXPECT(mm_status(session) == MM_OK);
    }
    EXPECT(mm_durable_step(session) == 1 && mm_close(session, MM_KEEP) == MM_OK);

    /* the same object for another session, which is not as far */
    mm_session *other = mm_session_new(server);
    mm_points(other, 2, 4, points);
    mm_cells(other, "triangle", 2, triangles);
    mm_patch(other, "left", "moving", 2, left);
    mm_patch(other, "right", "fixed", 2, right);
    EXPECT(mm_open(other) == MM_OK && mm_build(other) == MM_OK);
    mm_set_credentials(session, mm_id(other), mm_token(other));
    EXPECT(mm_resume(session) == MM_OK && mm_step(session) == 0);
    EXPECT(mm_close(session, MM_DISCARD) == MM_OK);
    mm_context_free(server); /* and all sessions */
    return failures != 0;
}
