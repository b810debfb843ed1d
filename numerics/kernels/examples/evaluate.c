/* A square turns inside a square, in this process: no server, no Python.
 *
 *     evaluate [POINTS]
 *
 * The displacement of the inner and of the outer square is interpolated by Wendland's C2 function, whose weights come
 * from a small dense system. The nodes of the mesh between them move with the interpolant, and the cells are judged
 * against themselves at rest. POINTS receives the final coordinates (float64, x and y of each node). */
#include <mesh_motion_kernels.h>

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#define CELLS 12
#define LOW 4 /* the inner square's cells: LOW to HIGH in both directions */
#define HIGH 8
#define RADIUS 0.8
#define MOST ((CELLS + 1) * (CELLS + 1))
#define WORST 3

static double points[2 * MOST], centres[2 * MOST], given[2 * MOST], weights[2 * MOST];
static int64_t quads[4 * CELLS * CELLS], node_count, quad_count, centre_count;

/* A call that must succeed. */
static void check(int result)
{
    if (result != MESH_MOTION_OK) {
        fprintf(stderr, "%s\n", mesh_motion_kernels_error());
        exit(1);
    }
}

/* The unit square in CELLS x CELLS cells, without those of the inner square; the nodes of both squares are control
 * points: the inner ones turn (cosine 0.8) and move, the outer ones stay. */
static void make_mesh(void)
{
    int64_t number[CELLS + 1][CELLS + 1];
    for (int j = 0; j <= CELLS; ++j) {
        for (int i = 0; i <= CELLS; ++i) {
            int inner = i >= LOW && i <= HIGH && j >= LOW && j <= HIGH;
            int outer = i == 0 || i == CELLS || j == 0 || j == CELLS;
            if (i > LOW && i < HIGH && j > LOW && j < HIGH) {
                continue;
            }
            double x = (double)i / CELLS, y = (double)j / CELLS;
            points[2 * node_count] = x;
            points[2 * node_count + 1] = y;
            number[j][i] = node_count++;
            if (inner || outer) {
                centres[2 * centre_count] = x;
                centres[2 * centre_count + 1] = y;
                given[2 * centre_count] = inner ? -0.2 * (x - 0.5) - 0.6 * (y - 0.5) + 0.03 : 0.0;
                given[2 * centre_count + 1] = inner ? 0.6 * (x - 0.5) - 0.2 * (y - 0.5) + 0.02 : 0.0;
                ++centre_count;
            }
        }
    }
    for (int j = 0; j < CELLS; ++j) {
        for (int i = 0; i < CELLS; ++i) {
            if (i >= LOW && i < HIGH && j >= LOW && j < HIGH) {
                continue;
            }
            int64_t corners[] = {number[j][i], number[j][i + 1], number[j + 1][i + 1], number[j + 1][i]};
            for (int k = 0; k < 4; ++k) {
                quads[4 * quad_count + k] = corners[k];
            }
            ++quad_count;
        }
    }
}

/* Column j of the interpolation matrix: the basis function of control point j, at all control points. */
static void fill_column(int64_t j, double *column)
{
    const double one = 1.0;
    mesh_motion_interpolant *single = NULL;
    check(mesh_motion_interpolant_create("wendland-c2", RADIUS, 2, 1, centres + 2 * j, 1, &one, &single));
    check(mesh_motion_interpolant_values(single, centre_count, centres, MESH_MOTION_WRITE, column));
    mesh_motion_interpolant_free(single);
}

/* Weights with which the interpolant reproduces the given displacements: the Cholesky factor L of the matrix, which is
 * symmetric and positive definite, then two solves with L and its transpose. */
static void solve(void)
{
    int64_t n = centre_count;
    double *matrix = calloc((size_t)(n * n), sizeof *matrix);
    if (!matrix) {
        exit(1);
    }
    for (int64_t j = 0; j < n; ++j) {
        fill_column(j, matrix + j * n);
    }
    for (int64_t i = 0; i < n; ++i) {
        for (int64_t j = 0; j <= i; ++j) {
            double sum = matrix[i * n + j];
            for (int64_t k = 0; k < j; ++k) {
                sum -= matrix[i * n + k] * matrix[j * n + k];
            }
            matrix[i * n + j] = i == j ? sqrt(sum) : sum / matrix[j * n + j];
        }
    }
    for (int c = 0; c < 2; ++c) {
        for (int64_t i = 0; i < n; ++i) {
            double sum = given[2 * i + c];
            for (int64_t k = 0; k < i; ++k) {
                sum -= matrix[i * n + k] * weights[2 * k + c];
            }
            weights[2 * i + c] = sum / matrix[i * n + i];
        }
        for (int64_t i = n; i-- > 0;) {
            double sum = weights[2 * i + c];
            for (int64_t k = i + 1; k < n; ++k) {
                sum -= matrix[k * n + i] * weights[2 * k + c];
            }
            weights[2 * i + c] = sum / matrix[i * n + i];
        }
    }
    free(matrix);
}

int main(int count, char **arguments)
{
    static double moved[2 * MOST], sizes[CELLS * CELLS];
    make_mesh();
    solve();

    mesh_motion_cells *cells = NULL;
    check(mesh_motion_cells_create(&cells));
    check(mesh_motion_cells_add(cells, "quad", quad_count, quads));
    check(mesh_motion_cell_sizes(cells, node_count, points, sizes));

    mesh_motion_interpolant *field = NULL;
    check(mesh_motion_interpolant_create("wendland-c2", RADIUS, 2, centre_count, centres, 2, weights, &field));
    check(mesh_motion_interpolant_values(field, node_count, points, MESH_MOTION_WRITE, moved));
    for (int64_t i = 0; i < 2 * node_count; ++i) {
        moved[i] += points[i];
    }

    int64_t numbers[WORST];
    double values[WORST];
    mesh_motion_quality quality;
    check(mesh_motion_judge_cells(cells, node_count, moved, sizes, NULL, NULL, "size-skew", WORST, numbers, values,
                                  &quality));
    printf("size-skew of %" PRId64 " cells: minimum %.6f, mean %.6f, median %.6f, %" PRId64 " inverted\n", quad_count,
           quality.size_skew.minimum, quality.size_skew.mean, quality.size_skew.p50, quality.inverted);
    for (int s = 0; s < WORST; ++s) {
        printf("cell %" PRId64 ": %.6f\n", numbers[s], values[s]);
    }
    mesh_motion_interpolant_free(field);
    mesh_motion_cells_free(cells);

    FILE *file = count > 1 ? fopen(arguments[1], "wb") : NULL;
    if (file) {
        fwrite(moved, sizeof *moved, (size_t)(2 * node_count), file);
        fclose(file);
    }
    return 0;
}
