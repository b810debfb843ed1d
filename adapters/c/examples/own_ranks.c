/* The ranks of a solver move their own nodes and compute the quality of their cells; the server has the boundary only.
 *
 *     mpiexec -n 4 own_ranks ENDPOINT [CELLS [POINTS [THRESHOLD]]]
 *
 * A body swims in a cube of CELLS hexahedra along each side. Each rank makes its own slab of the mesh; the first rank
 * opens the session and shares its credentials, the others join. POINTS.RANK receives the final coordinates: number of
 * nodes, their numbers in the whole mesh (int64), x, y and z of each (float64). With a THRESHOLD the body moves ten times
 * as far, and the server corrects cells whose quality falls below. */
#include <mesh_motion.h>

#include <mpi.h>

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>

#define STEPS 3

typedef struct {
    int64_t side, low, high;         /* cells along a side of the cube; those of the body: from low to high - 1 */
    int64_t first, last;             /* the slab's cells along x */
    int64_t nodes, cells, body, wall;
    int64_t *ids, *hexahedra, *on_body, *on_wall;
    double *points;
} slab;

static void *memory(size_t count, size_t size)
{
    void *found = calloc(count + 1, size);
    if (!found) {
        fprintf(stderr, "there is no memory\n");
        MPI_Abort(MPI_COMM_WORLD, 1);
    }
    return found;
}

static int in_body(const slab *mesh, int64_t i, int64_t j, int64_t k)
{
    int64_t low = mesh->low, high = mesh->high;
    return low <= i && i < high && low <= j && j < high && low <= k && k < high;
}

/* Cells first refer to nodes by their place in the slab's planes, and later by their number among the nodes that belong
 * to cells. */
static void make_cells(slab *mesh, int64_t *number)
{
    static const int CORNERS[8][3] = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0},
                                      {0, 0, 1}, {1, 0, 1}, {1, 1, 1}, {0, 1, 1}};
    int64_t n = mesh->side + 1, planes = mesh->last - mesh->first;
    mesh->hexahedra = memory((size_t)(8 * planes * mesh->side * mesh->side), sizeof *mesh->hexahedra);
    for (int64_t i = mesh->first; i < mesh->last; ++i) {
        for (int64_t j = 0; j < mesh->side; ++j) {
            for (int64_t k = 0; k < mesh->side; ++k) {
                for (int c = 0; c < 8 && !in_body(mesh, i, j, k); ++c) {
                    int64_t place = ((i + CORNERS[c][0] - mesh->first) * n + j + CORNERS[c][1]) * n + k + CORNERS[c][2];
                    mesh->hexahedra[8 * mesh->cells + c] = place;
                    number[place] = 1;
                }
                mesh->cells += !in_body(mesh, i, j, k);
            }
        }
    }
    for (int64_t place = 0; place < (planes + 1) * n * n; ++place) {
        number[place] = number[place] ? mesh->nodes++ : -1;
    }
    for (int64_t corner = 0; corner < 8 * mesh->cells; ++corner) {
        mesh->hexahedra[corner] = number[mesh->hexahedra[corner]];
    }
}

static void make_nodes(slab *mesh, const int64_t *number)
{
    int64_t n = mesh->side + 1;
    size_t nodes = (size_t)mesh->nodes;
    mesh->ids = memory(nodes, sizeof *mesh->ids);
    mesh->points = memory(3 * nodes, sizeof *mesh->points);
    mesh->on_body = memory(nodes, sizeof *mesh->on_body);
    mesh->on_wall = memory(nodes, sizeof *mesh->on_wall);
    for (int64_t place = 0; place < (mesh->last - mesh->first + 1) * n * n; ++place) {
        int64_t node = number[place], at[] = {mesh->first + place / (n * n), place / n % n, place % n};
        int is_body = node >= 0, is_wall = 0;
        for (int axis = 0; axis < 3 && node >= 0; ++axis) {
            mesh->points[3 * node + axis] = (double)at[axis] / (double)mesh->side;
            is_body = is_body && mesh->low <= at[axis] && at[axis] <= mesh->high;
            is_wall = is_wall || at[axis] == 0 || at[axis] == mesh->side;
        }
        if (node >= 0) {
            mesh->ids[node] = (at[0] * n + at[1]) * n + at[2];
        }
        if (is_body) {
            mesh->on_body[mesh->body++] = node;
        }
        if (is_wall) {
            mesh->on_wall[mesh->wall++] = node;
        }
    }
}

static slab make_slab(int64_t side, int rank, int ranks)
{
    slab mesh = {.side = side, .low = side * 5 / 12, .high = side * 7 / 12};
    mesh.first = side * rank / ranks;
    mesh.last = side * (rank + 1) / ranks;
    int64_t *number = memory((size_t)((mesh.last - mesh.first + 1) * (side + 1) * (side + 1)), sizeof *number);
    make_cells(&mesh, number);
    make_nodes(&mesh, number);
    free(number);
    return mesh;
}

/* A call that must succeed, on all ranks. */
static void check(const mm_context *server)
{
    if (mm_error(server)) {
        fprintf(stderr, "%s: %s. %s\n", mm_error_code(server), mm_error_message(server), mm_error_hint(server));
        MPI_Abort(MPI_COMM_WORLD, 1);
    }
}

/* Each rank describes its part with the same calls as for a whole mesh. */
static void describe(mm_session *session, const slab *mesh, int rank, int ranks)
{
    mm_set_partition(session, rank, ranks);
    mm_points(session, 3, (size_t)mesh->nodes, mesh->points);
    mm_global_ids(session, mesh->ids);
    mm_cells(session, "hexahedron", (size_t)mesh->cells, mesh->hexahedra);
    if (mesh->body) {
        mm_patch(session, "body", "moving", (size_t)mesh->body, mesh->on_body);
    }
    if (mesh->wall) {
        mm_patch(session, "wall", "fixed", (size_t)mesh->wall, mesh->on_wall);
    }
}

/* The first rank opens, and the others join by its credentials. */
static void open_together(mm_session *session, int rank, double threshold)
{
    char id[MM_ID_SIZE] = "";
    uint8_t token[MM_TOKEN_BYTES] = {0};
    if (rank == 0) {
        mm_set_evaluation(session, "client");
        mm_set_text(session, "displacement", "absolute");
        mm_set_text(session, "correction", threshold > 0.0 ? "optimised" : "none");
        if (threshold > 0.0) {
            mm_set_text(session, "correction_target", "threshold");
            mm_set_number(session, "quality_threshold", threshold);
        }
        mm_set_text(session, "sub_steps", "never");
        if (mm_open(session) == MM_OK) {
            for (int i = 0; i < MM_ID_SIZE; ++i) {
                id[i] = mm_id(session)[i];
            }
            for (int i = 0; i < MM_TOKEN_BYTES; ++i) {
                token[i] = mm_token(session)[i];
            }
        }
    }
    MPI_Bcast(id, MM_ID_SIZE, MPI_CHAR, 0, MPI_COMM_WORLD);
    MPI_Bcast(token, MM_TOKEN_BYTES, MPI_BYTE, 0, MPI_COMM_WORLD);
    if (rank) {
        mm_set_credentials(session, id, token);
        mm_join(session);
    }
    mm_build(session);
}

/* The body turns, shifts and swells: total displacement of each moving node. */
static void fill_motion(mm_session *session, const slab *mesh, double size, double *displacement)
{
    size_t count;
    const int64_t *nodes = mm_moving_nodes(session, &count);
    for (size_t i = 0; i < count; ++i) {
        const double *at = mesh->points + 3 * nodes[i];
        displacement[3 * i] = size * (at[1] - 0.5);
        displacement[3 * i + 1] = size * (0.5 - at[0]);
        displacement[3 * i + 2] = size * (at[0] * at[2]);
    }
}

static void write_points(const char *name, int rank, const slab *mesh, const double *points)
{
    char path[4096];
    snprintf(path, sizeof path, "%s.%d", name, rank);
    FILE *file = fopen(path, "wb");
    if (file) {
        fwrite(&mesh->nodes, sizeof mesh->nodes, 1, file);
        fwrite(mesh->ids, sizeof *mesh->ids, (size_t)mesh->nodes, file);
        fwrite(points, sizeof *points, (size_t)(3 * mesh->nodes), file);
        fclose(file);
    }
}

int main(int count, char **arguments)
{
    int rank, ranks;
    MPI_Init(&count, &arguments);
    MPI_Comm_rank(MPI_COMM_WORLD, &rank);
    MPI_Comm_size(MPI_COMM_WORLD, &ranks);
    double threshold = count > 4 ? atof(arguments[4]) : 0.0;
    slab mesh = make_slab(count > 2 ? atoll(arguments[2]) : 24, rank, ranks);

    mm_context *server = mm_context_new();
    mm_connect(server, count > 1 ? arguments[1] : "tcp://127.0.0.1:7440");
    mm_session *session = mm_session_new(server);
    describe(session, &mesh, rank, ranks);
    open_together(session, rank, threshold);
    check(server);

    size_t moving, nodes = (size_t)mesh.nodes;
    mm_moving_nodes(session, &moving);
    double *displacement = memory(3 * moving, sizeof *displacement), *answer = memory(3 * nodes, sizeof *answer);
    for (int step = 1; step <= STEPS; ++step) {
        double began = MPI_Wtime();
        fill_motion(session, &mesh, (threshold > 0.0 ? 0.2 : 0.02) * step, displacement);
        mm_move(session, MM_SINCE_REFERENCE, moving, displacement, nodes, answer);
        mm_commit(session);
        check(server);
        if (rank == 0) {
            const mm_report *moved = mm_moved(session);
            printf("step %d: %" PRId64 " cells, minimum %.17g, median %.17g; %" PRId64 " nodes freed, %.3f s\n", step,
                   mm_report_integer(moved, "quality.corrected.cells", 0),
                   mm_report_number(moved, "quality.corrected.size_skew.min"),
                   mm_report_number(moved, "quality.corrected.size_skew.p50"),
                   mm_report_integer(moved, "correction.freed_nodes", 0), MPI_Wtime() - began);
        }
    }
    mm_fetch(session, MM_SINCE_COMMITTED, nodes, answer);
    check(server);
    if (count > 3) {
        write_points(arguments[3], rank, &mesh, answer);
    }
    MPI_Barrier(MPI_COMM_WORLD); /* CLOSE ends the session for all ranks */
    mm_close(session, MM_DISCARD);
    mm_context_free(server);
    free(displacement);
    free(answer);
    free(mesh.ids);
    free(mesh.points);
    free(mesh.hexahedra);
    free(mesh.on_body);
    free(mesh.on_wall);
    MPI_Finalize();
    return 0;
}
