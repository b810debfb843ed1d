/* The driver program of the C client for the conformance suite: it reads verbs and prints one JSON object per line.
 * protocol/conformance/README.md has the contract. */
#include <mesh_motion.h>

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const double POINTS[] = {0, 0, 1, 0, 1, 1, 0, 1};
static const int64_t TRIANGLES[] = {0, 1, 2, 0, 2, 3}, LEFT[] = {0, 3}, RIGHT[] = {1, 2};

typedef struct {
    mm_context *context;
    mm_session *session;
    const char *endpoint;
    int moves;
} driver;

static void print_numbers(const char *key, const double *numbers, size_t count)
{
    printf(", \"%s\": [", key);
    for (size_t i = 0; i < count; ++i) {
        printf("%s%.17g", i ? ", " : "", numbers[i]);
    }
    printf("]");
}

static void print_report(const char *key, const mm_report *report, const char *path)
{
    char text[256];
    mm_report_json(report, path, text, sizeof text);
    printf(", \"%s\": %s", key, text);
}

/* The mesh of the contract. */
static void open_session(driver *run)
{
    size_t count;
    if (!run->session) {
        run->session = mm_session_new(run->context);
        mm_points(run->session, 2, 4, POINTS);
        mm_cells(run->session, "triangle", 2, TRIANGLES);
        mm_patch(run->session, "left", "moving", 2, LEFT);
        mm_patch(run->session, "right", "fixed", 2, RIGHT);
        mm_open(run->session);
    }
    if (mm_build(run->session) == MM_OK) {
        const int64_t *moving = mm_moving_nodes(run->session, &count);
        double numbers[4] = {0};
        for (size_t i = 0; i < count && i < 4; ++i) {
            numbers[i] = (double)moving[i];
        }
        print_numbers("moving_nodes", numbers, count < 4 ? count : 4);
    }
}

/* Resume with a new session object, as another program would. */
static void resume(driver *run)
{
    mm_session *again = mm_session_new(run->context);
    mm_set_credentials(again, mm_id(run->session), mm_token(run->session));
    if (mm_resume(again) == MM_OK) {
        printf(", \"step\": %" PRId64, mm_step(again));
    }
    mm_session_free(run->session);
    run->session = again;
}

static void move(driver *run, mm_frame frame)
{
    double k = run->moves, answer[8];
    double rows[] = {k / 8, k / 16, k / 8, k / 16};
    if (mm_move(run->session, frame, 2, rows, 4, answer) == MM_OK) {
        printf(", \"iteration\": %" PRId64, mm_iteration(run->session));
        print_numbers("displacement", answer, 8);
    }
}

static void commit(driver *run)
{
    if (mm_commit(run->session) == MM_OK) {
        printf(", \"step\": %" PRId64, mm_step(run->session));
        print_report("digest", mm_committed(run->session), "digest");
    }
}

static void status(driver *run)
{
    if (mm_status(run->session) == MM_OK) {
        print_report("state", mm_status_report(run->session), "state");
        print_report("step", mm_status_report(run->session), "step");
    }
}

static void points(driver *run)
{
    double answer[8];
    if (mm_fetch(run->session, MM_SINCE_COMMITTED, 4, answer) == MM_OK) {
        print_numbers("points", answer, 8);
    }
}

static void tangent(driver *run)
{
    const double velocity[] = {0.25, 0.125, 0.25, 0.125};
    double answer[8];
    if (mm_tangent(run->session, 1, 2, velocity, 4, answer) == MM_OK) {
        print_numbers("velocity", answer, 8);
    }
}

static void cotangent(driver *run)
{
    const double weights[] = {0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875, 1};
    double answer[4];
    if (mm_cotangent(run->session, 1, 4, weights, 2, answer) == MM_OK) {
        print_numbers("weights", answer, 4);
    }
}

static void hello(driver *run)
{
    if (mm_connect(run->context, run->endpoint) == MM_OK) {
        print_report("version", mm_welcome(run->context), "version");
    }
}

static void call(driver *run, const char *verb)
{
    if (strcmp(verb, "hello") == 0) {
        hello(run);
    } else if (strcmp(verb, "open") == 0) {
        open_session(run);
    } else if (!run->session) {
        return; /* an earlier verb has reported that there is no session */
    } else if (strcmp(verb, "move") == 0 || strcmp(verb, "move-reference") == 0) {
        move(run, strcmp(verb, "move") == 0 ? MM_SINCE_COMMITTED : MM_SINCE_REFERENCE);
    } else if (strcmp(verb, "tangent") == 0) {
        tangent(run);
    } else if (strcmp(verb, "cotangent") == 0) {
        cotangent(run);
    } else if (strcmp(verb, "commit") == 0) {
        commit(run);
    } else if (strcmp(verb, "rollback") == 0) {
        mm_rollback(run->session);
    } else if (strcmp(verb, "status") == 0) {
        status(run);
    } else if (strcmp(verb, "points") == 0) {
        points(run);
    } else if (strcmp(verb, "resume") == 0) {
        resume(run);
    } else {
        mm_close(run->session, strcmp(verb, "discard") == 0 ? MM_DISCARD : MM_KEEP);
    }
}

static void print_line(driver *run, const char *verb, const char *called)
{
    printf("{\"verb\": \"%s\"", verb);
    call(run, called);
    if (mm_error(run->context)) {
        printf(", \"ok\": false, \"code\": \"%s\"}\n", mm_error_code(run->context));
    } else {
        printf(", \"ok\": true}\n");
    }
    fflush(stdout);
    mm_clear_error(run->context);
}

static const char *option(int count, char **arguments, const char *name)
{
    for (int i = 1; i + 1 < count; i += 2) {
        if (strcmp(arguments[i], name) == 0) {
            return arguments[i + 1];
        }
    }
    fprintf(stderr, "usage: driver --endpoint ENDPOINT --timeout SECONDS --scenario 'VERB VERB ...'\n");
    exit(2);
}

int main(int count, char **arguments)
{
    driver run = {0};
    char verbs[1024];
    double seconds = atof(option(count, arguments, "--timeout"));
    run.endpoint = option(count, arguments, "--endpoint");
    run.context = mm_context_new();
    mm_set_timeouts(run.context, seconds, seconds);
    snprintf(verbs, sizeof verbs, "%s", option(count, arguments, "--scenario"));
    const char *called = "hello";
    for (char *verb = strtok(verbs, " "); verb; verb = strtok(NULL, " ")) {
        if (strcmp(verb, "again") != 0) {
            called = verb;
            run.moves += strncmp(verb, "move", 4) == 0;
        }
        print_line(&run, verb, called);
    }
    mm_context_free(run.context);
    return 0;
}
