/* One rank of a driver with two: two_ranks ENDPOINT CREDENTIALS RANK POINTS
 *
 * A square of N x N cells; rank 0 has the cells below the middle, rank 1 those
 * above. The left side moves. */
#define _POSIX_C_SOURCE 200809L
#include <mesh_motion.h>

#include <stdio.h>
#include <stdlib.h>
#include <time.h>
#include <unistd.h>

#define N 8
#define ROWS (N / 2 + 1)
#define NODES (ROWS * (N + 1))

int main(int count, char **arguments)
{
    static double points[2 * NODES], rows[2 * ROWS], displacement[2 * NODES];
    static int64_t ids[NODES], left[ROWS], right[ROWS];
    static int32_t quads[4 * N * N / 2];
    if (count != 5) {
        return 2;
    }
    int rank = atoi(arguments[3]), first = rank * N / 2, quad = 0;
    for (int j = 0; j < ROWS; ++j) {
        for (int i = 0; i <= N; ++i) {
            int node = j * (N + 1) + i;
            points[2 * node] = (double)i / N;
            points[2 * node + 1] = (double)(first + j) / N;
            ids[node] = (first + j) * (N + 1) + i;
            if (i < N && j < ROWS - 1) {
                int32_t corners[] = {node, node + 1, node + N + 2, node + N + 1};
                for (int k = 0; k < 4; ++k) {
                    quads[quad++] = corners[k];
                }
            }
        }
        left[j] = j * (N + 1);
        right[j] = j * (N + 1) + N;
    }
    mm_context *server = mm_context_new();
    mm_set_timeouts(server, 60, 60);
    mm_connect(server, arguments[1]);
    mm_session *session = mm_session_new(server);
    mm_set_partition(session, rank, 2);
    mm_points(session, 2, NODES, points);
    mm_global_ids(session, ids);
    mm_cells32(session, "quad", N * N / 2, quads);
    mm_patch(session, "left", "moving", ROWS, left);
    mm_patch(session, "right", "fixed", ROWS, right);
    if (rank == 0) {
        mm_open(session);
        mm_save_credentials(session, arguments[2]);
    } else {
        for (int tries = 0; tries < 6000 && access(arguments[2], R_OK) != 0; ++tries) {
            nanosleep(&(struct timespec){0, 10000000}, NULL);
        }
        mm_load_credentials(session, arguments[2]);
        mm_join(session);
    }
    mm_build(session);
    mm_set_final_step(session, 7 + rank); /* the largest counts */
    size_t moving = 0;
    const int64_t *nodes = mm_moving_nodes(session, &moving);
    for (int step = 1; step <= 3 && moving <= ROWS; ++step) {
        for (size_t k = 0; k < moving; ++k) {
            rows[2 * k] = 0.01 * step * points[2 * nodes[k] + 1];
            rows[2 * k + 1] = 0.01 * step;
        }
        mm_move(session, MM_SINCE_COMMITTED, moving, rows, NODES, displacement);
        mm_commit(session);
    }
    mm_fetch(session, MM_SINCE_COMMITTED, NODES, points);
    mm_status(session);
    int final_step = (int)mm_report_number(mm_status_report(session), "report.final_step");
    mm_close(session, MM_DISCARD);
    if (mm_error(server)) {
        fprintf(stderr, "rank %d: %s: %s\n", rank, mm_error_code(server), mm_error_message(server));
        return 1;
    }
    if (final_step != 8) {
        fprintf(stderr, "rank %d: the run ends with step 8, not %d\n", rank, final_step);
    }
    FILE *file = fopen(arguments[4], "wb");
    fwrite(points, sizeof *points, 2 * NODES, file);
    fclose(file);
    mm_context_free(server);
    return 0;
}
