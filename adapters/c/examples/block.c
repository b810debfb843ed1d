/* A block turns and moves inside a square: a coupling code in C, from the mesh to the committed steps.
 *
 *     block tcp://127.0.0.1:7440 [POINTS]
 *
 * The mesh is made here, of quadrilaterals around a hole, as a flow solver has it. Each time step has three coupling
 * iterations, of which the last one is committed. Prints the quality of each step; POINTS receives the final
 * coordinates (float64, x and y of each node). */
#include <mesh_motion.h>

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>

#define CELLS 16
#define LOW 6 /* the block's cells: LOW to HIGH in both directions */
#define HIGH 10
#define STEPS 4
#define ITERATIONS 3
#define MOST ((CELLS + 1) * (CELLS + 1))

static double points[2 * MOST];
static int64_t quads[4 * CELLS * CELLS], block[MOST], walls[MOST];
static size_t node_count, quad_count, block_count, wall_count;

/* The unit square in CELLS x CELLS cells, without those of the block; nodes count from 0. */
static void make_mesh(void)
{
    int64_t number[CELLS + 1][CELLS + 1];
    for (int j = 0; j <= CELLS; ++j) {
        for (int i = 0; i <= CELLS; ++i) {
            int inside = i > LOW && i < HIGH && j > LOW && j < HIGH;
            if (inside) {
                continue;
            }
            number[j][i] = (int64_t)node_count;
            points[2 * node_count] = (double)i / CELLS;
            points[2 * node_count + 1] = (double)j / CELLS;
            if (i >= LOW && i <= HIGH && j >= LOW && j <= HIGH) {
                block[block_count++] = number[j][i];
            }
            if (i == 0 || i == CELLS || j == 0 || j == CELLS) {
                walls[wall_count++] = number[j][i];
            }
            ++node_count;
        }
    }
    for (int j = 0; j < CELLS; ++j) {
        for (int i = 0; i < CELLS; ++i) {
            if (i >= LOW && i < HIGH && j >= LOW && j < HIGH) {
                continue;
            }
            int64_t corners[] = {number[j][i], number[j][i + 1], number[j + 1][i + 1], number[j + 1][i]};
            for (int k = 0; k < 4; ++k) {
                quads[4 * quad_count + (size_t)k] = corners[k];
            }
            ++quad_count;
        }
    }
}

/* The boundary's displacement, which a structural solver would give: a share of a rotation (cosine 0.96) and of a
 * translation, for each moving node, since the reference mesh. */
static void displace(double share, size_t count, const int64_t *moving, double *rows)
{
    for (size_t i = 0; i < count; ++i) {
        double x = points[2 * moving[i]] - 0.5, y = points[2 * moving[i] + 1] - 0.5;
        rows[2 * i] = share * (-0.04 * x - 0.28 * y + 0.1);
        rows[2 * i + 1] = share * (0.28 * x - 0.04 * y + 0.05);
    }
}

int main(int count, char **arguments)
{
    static double rows[2 * MOST], displacement[2 * MOST];
    double lowest = 1.0;
    size_t moving_count = 0;
    make_mesh();
    mm_context *server = mm_context_new();
    mm_connect(server, count > 1 ? arguments[1] : "tcp://127.0.0.1:7440");
    mm_session *session = mm_session_new(server);
    mm_points(session, 2, node_count, points);
    mm_cells(session, "quad", quad_count, quads);
    mm_patch(session, "block", "moving", block_count, block);
    mm_patch(session, "walls", "fixed", wall_count, walls);
    mm_set_number(session, "support_radius", 0.5);
    mm_open(session);
    mm_build(session);
    mm_set_final_step(session, STEPS); /* so that the monitor can show when the run ends */
    /* errors are sticky: after the first one the calls below do nothing, and one check at the end of a step is enough
     * */
    const int64_t *moving = mm_moving_nodes(session, &moving_count);
    for (int step = 1; step <= STEPS && mm_error(server) == MM_OK; ++step) {
        for (int iteration = 1; iteration <= ITERATIONS; ++iteration) {
            double share = (step - 1 + (double)iteration / ITERATIONS) / STEPS;
            displace(share, moving_count, moving, rows);
            mm_move(session, MM_SINCE_REFERENCE, moving_count, rows, node_count, displacement);
            /* here the flow solver takes points + displacement, and gives loads to the structure */
        }
        if (mm_commit(session) == MM_OK) {
            double quality = mm_report_number(mm_committed(session), "quality.metric.min");
            lowest = quality < lowest ? quality : lowest;
            printf("step %" PRId64 ": quality at least %.6f\n", mm_step(session), quality);
        }
    }
    mm_fetch(session, MM_SINCE_COMMITTED, node_count, displacement);
    mm_close(session, MM_DISCARD);
    if (mm_error(server)) {
        fprintf(stderr, "%s: %s\n%s\n", mm_error_code(server), mm_error_message(server), mm_error_hint(server));
        mm_context_free(server);
        return 1;
    }
    mm_context_free(server);
    printf("minimum quality %.6f\n", lowest);
    FILE *file = count > 2 ? fopen(arguments[2], "wb") : NULL;
    if (file) {
        fwrite(displacement, sizeof *displacement, 2 * node_count, file);
        fclose(file);
    }
    return 0;
}
