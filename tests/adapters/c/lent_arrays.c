/* Uploads to a server that stops reading, gives up, and frees its arrays:
 * lent_arrays ENDPOINT
 *
 * What libzmq has not sent by then must not be read any more. Prints a line,
 * then waits for one: meanwhile the server reads on. */
#include <mesh_motion.h>

#include <stdio.h>
#include <stdlib.h>

int main(int count, char **arguments)
{
    size_t nodes = (size_t)8 << 20; /* more than a server reads before it stops */
    double *points = malloc(3 * nodes * sizeof *points);
    for (size_t i = 0; i < 3 * nodes; ++i) {
        points[i] = 0.5;
    }
    mm_context *server = mm_context_new();
    mm_set_timeouts(server, 1.0, 1.0);
    mm_connect(server, count > 1 ? arguments[1] : "");
    mm_session *session = mm_session_new(server);
    mm_points(session, 3, nodes, points);
    mm_open(session);
    mm_build(session);
    free(points);
    printf("%s\n", mm_error_code(server));
    fflush(stdout);
    getchar();
    mm_context_free(server);
    return 0;
}
