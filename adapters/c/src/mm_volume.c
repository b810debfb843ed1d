#ifdef MM_EVALUATION /* else the library has no kernels */

#include "mm_volume.h"

#include <stdlib.h>
#include <string.h>

struct mmv_volume {
    int dimension;
    size_t nodes, cell_count, uploaded_count, boundary_count; /* the first uploaded nodes; then those near walls */
    double *points, *moved; /* positions of the nodes at rest, and at the last quality computation */
    mesh_motion_cells *cells;
    bool *is_uploaded, *has_cell, *is_sent; /* the last: of cells */
    int64_t *uploaded;
    const mesh_motion_facets *facets; /* of the boundary */
    int64_t *ids; /* in the whole mesh; NULL: the same */
    mesh_motion_tally *tally;
    char metric[32];
    mmv_field field;
    mesh_motion_near **near; /* for each sum except the coarse field; NULL: the sum is evaluated without it */
};

static void free_field(mmv_field *field)
{
    free(field->sums);
    free(field->centres);
    free(field->boxes);
    free(field->coefficients);
    *field = (mmv_field){0};
}

static void free_near(mmv_volume *volume)
{
    for (size_t s = 0; volume->near && s < volume->field.sum_count; ++s) {
        mesh_motion_near_free(volume->near[s]);
    }
    free(volume->near);
    volume->near = NULL;
}

mmv_volume *mmv_new(int dimension, size_t nodes, const double *points)
{
    mmv_volume *volume = calloc(1, sizeof *volume);
    size_t numbers = nodes * (size_t)dimension;
    if (!volume) {
        return NULL;
    }
    volume->dimension = dimension;
    volume->nodes = nodes;
    volume->points = malloc(numbers * sizeof *volume->points);
    volume->moved = malloc(numbers * sizeof *volume->moved);
    volume->is_uploaded = calloc(nodes, sizeof *volume->is_uploaded);
    volume->has_cell = calloc(nodes, sizeof *volume->has_cell);
    if (!volume->points || !volume->moved || !volume->is_uploaded || !volume->has_cell
        || mesh_motion_cells_create(&volume->cells) != MESH_MOTION_OK) {
        mmv_free(volume);
        return NULL;
    }
    memcpy(volume->points, points, numbers * sizeof *points);
    return volume;
}

void mmv_free(mmv_volume *volume)
{
    if (!volume) {
        return;
    }
    mesh_motion_tally_free(volume->tally);
    mesh_motion_cells_free(volume->cells);
    mesh_motion_facets_free(volume->facets);
    free_near(volume);
    free_field(&volume->field);
    free(volume->points);
    free(volume->moved);
    free(volume->is_uploaded);
    free(volume->has_cell);
    free(volume->is_sent);
    free(volume->uploaded);
    free(volume->ids);
    free(volume);
}

int mmv_add_cells(mmv_volume *volume, const char *type, size_t cells, size_t corners, const void *nodes, size_t width)
{
    for (size_t i = 0; i < cells * corners; ++i) {
        uint64_t node = (uint64_t)(width == 8 ? ((const int64_t *)nodes)[i] : ((const int32_t *)nodes)[i]);
        if (node < volume->nodes) { /* all others are refused below */
            volume->has_cell[node] = true;
        }
    }
    volume->cell_count += cells;
    if (width == 8) {
        return mesh_motion_cells_add(volume->cells, type, (int64_t)cells, nodes);
    }
    int64_t *wide = malloc((cells * corners + 1) * sizeof *wide);
    if (!wide) {
        return MESH_MOTION_OUT_OF_MEMORY;
    }
    for (size_t i = 0; i < cells * corners; ++i) {
        wide[i] = ((const int32_t *)nodes)[i];
    }
    int result = mesh_motion_cells_add(volume->cells, type, (int64_t)cells, wide);
    free(wide);
    return result;
}

int mmv_set_ids(mmv_volume *volume, const int64_t *ids)
{
    volume->ids = malloc((volume->nodes + 1) * sizeof *volume->ids);
    if (!volume->ids) {
        return MESH_MOTION_OUT_OF_MEMORY;
    }
    memcpy(volume->ids, ids, volume->nodes * sizeof *ids);
    return MESH_MOTION_OK;
}

int64_t mmv_id_of(const mmv_volume *volume, int64_t node) { return volume->ids ? volume->ids[node] : node; }

void mmv_add_patch(mmv_volume *volume, size_t nodes, const int64_t *indices)
{
    for (size_t i = 0; i < nodes; ++i) {
        volume->is_uploaded[indices[i]] = true;
    }
}

/* The first node with the lowest coordinate along an axis, and with the highest. */
static void mark_extremes(mmv_volume *volume, size_t axis)
{
    size_t d = (size_t)volume->dimension, low = 0, high = 0;
    for (size_t i = 1; i < volume->nodes; ++i) {
        double x = volume->points[i * d + axis];
        low = x < volume->points[low * d + axis] ? i : low;
        high = x > volume->points[high * d + axis] ? i : high;
    }
    volume->is_uploaded[low] = volume->is_uploaded[high] = true;
}

/* The cells at rest, for a metric. */
static int make_tally(mmv_volume *volume, const char *metric)
{
    mesh_motion_tally_free(volume->tally);
    volume->tally = NULL;
    strncpy(volume->metric, metric, sizeof volume->metric - 1);
    return mesh_motion_tally_create(volume->cells, (int64_t)volume->nodes, volume->points, metric, &volume->tally);
}

int mmv_finish(mmv_volume *volume)
{
    int result = make_tally(volume, "size-skew"); /* refuses bad cells */
    if (result == MESH_MOTION_OK) {
        result = mesh_motion_facets_create(volume->cells, &volume->facets);
    }
    for (int64_t i = 0; result == MESH_MOTION_OK && i < 4 * volume->facets->count; ++i) {
        if (volume->facets->nodes[i] >= 0) {
            volume->is_uploaded[volume->facets->nodes[i]] = true;
        }
    }
    for (size_t axis = 0; axis < (size_t)volume->dimension; ++axis) {
        mark_extremes(volume, axis);
    }
    volume->uploaded_count = 0;
    for (size_t i = 0; result == MESH_MOTION_OK && i < volume->nodes; ++i) {
        volume->uploaded_count += volume->is_uploaded[i];
    }
    volume->boundary_count = volume->uploaded_count;
    volume->uploaded = malloc((volume->uploaded_count + 1) * sizeof *volume->uploaded);
    volume->is_sent = calloc(volume->cell_count + 1, sizeof *volume->is_sent);
    if (!volume->uploaded || !volume->is_sent) {
        return MESH_MOTION_OUT_OF_MEMORY;
    }
    for (size_t i = 0, row = 0; result == MESH_MOTION_OK && i < volume->nodes; ++i) {
        if (volume->is_uploaded[i]) {
            volume->uploaded[row++] = (int64_t)i;
        }
    }
    return result;
}

int64_t mmv_without_cell(const mmv_volume *volume)
{
    const bool *found = memchr(volume->has_cell, false, volume->nodes);
    return found ? found - volume->has_cell : -1;
}

const int64_t *mmv_uploaded(const mmv_volume *volume, size_t *count)
{
    *count = volume->uploaded_count;
    return volume->uploaded;
}

int64_t mmv_row_of(const mmv_volume *volume, int64_t node)
{
    size_t low = 0, high = volume->boundary_count;
    while (low < high) {
        size_t middle = (low + high) / 2;
        if (volume->uploaded[middle] < node) {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    return (int64_t)low;
}

bool mmv_is_uploaded(const mmv_volume *volume, int64_t node) { return volume->is_uploaded[node]; }

/* Corners of a facet. */
static size_t corners_of(const int64_t *facet)
{
    size_t count = 1;
    while (count < 4 && facet[count] >= 0) {
        ++count;
    }
    return count;
}

size_t mmv_count_facets(const mmv_volume *volume, size_t corners)
{
    size_t count = 0;
    for (int64_t i = 0; i < volume->facets->count; ++i) {
        count += corners_of(volume->facets->nodes + 4 * i) == corners;
    }
    return count;
}

void mmv_copy_facets(const mmv_volume *volume, size_t corners, int64_t *rows)
{
    for (int64_t i = 0; i < volume->facets->count; ++i) {
        const int64_t *facet = volume->facets->nodes + 4 * i;
        for (size_t k = 0; corners_of(facet) == corners && k < corners; ++k) {
            *rows++ = mmv_row_of(volume, facet[k]);
        }
    }
}

int mmv_extend(mmv_volume *volume, size_t count, const int64_t *nodes)
{
    int64_t *uploaded = realloc(volume->uploaded, (volume->uploaded_count + count + 1) * sizeof *uploaded);
    if (!uploaded) {
        return MESH_MOTION_OUT_OF_MEMORY;
    }
    volume->uploaded = uploaded;
    for (size_t i = 0; i < count; ++i) {
        uploaded[volume->uploaded_count++] = nodes[i];
        volume->is_uploaded[nodes[i]] = true;
    }
    return MESH_MOTION_OK;
}

int mmv_near(mmv_volume *volume, size_t facets, const double *wall, double reach, const mesh_motion_region **found,
             int64_t **rows)
{
    int64_t n = (int64_t)volume->nodes, *row = malloc((volume->nodes + 1) * sizeof *row);
    bool *near = malloc(volume->nodes + 1);
    int result = row && near ? MESH_MOTION_OK : MESH_MOTION_OUT_OF_MEMORY;
    if (result == MESH_MOTION_OK) {
        result = mesh_motion_near_facets(volume->dimension, n, volume->points, (int64_t)facets, wall, reach, near);
    }
    if (result == MESH_MOTION_OK) {
        result = mesh_motion_cells_about_create(volume->cells, n, near, volume->is_sent, found);
    }
    size_t added = 0;
    for (int64_t i = 0; result == MESH_MOTION_OK && i < (*found)->nodes; ++i) {
        if (!volume->is_uploaded[(*found)->indices[i]]) {
            row[added++] = (*found)->indices[i];
        }
    }
    result = result == MESH_MOTION_OK ? mmv_extend(volume, added, row) : result;
    for (size_t i = 0; result == MESH_MOTION_OK && i < volume->uploaded_count; ++i) {
        row[volume->uploaded[i]] = (int64_t)i;
    }
    *rows = result == MESH_MOTION_OK ? malloc(((size_t)(*found)->corners + 1) * sizeof **rows) : NULL;
    for (int64_t i = 0; *rows && i < (*found)->corners; ++i) {
        (*rows)[i] = row[(*found)->indices[(*found)->rows[i]]];
    }
    free(row);
    free(near);
    return result == MESH_MOTION_OK && !*rows ? MESH_MOTION_OUT_OF_MEMORY : result;
}

const double *mmv_points(const mmv_volume *volume) { return volume->points; }
const mesh_motion_tally *mmv_tally(const mmv_volume *volume) { return volume->tally; }

static int is_same(const void *one, const void *other, size_t count, size_t other_count, size_t size)
{
    return count == other_count && (count == 0 || memcmp(one, other, count * size) == 0);
}

/* Rows of coefficients of a sum. */
static size_t rows_of(const mmv_sum *sum, int dimension)
{
    return (size_t)sum->centres + (sum->has_polynomial ? (size_t)dimension + 1 : 0);
}

/* Coefficients of a box along an axis. */
static double layers_of(const double *box, size_t axis) { return box[4 + axis] > 0.0 ? box[4 + axis] + 3.0 : 1.0; }

static int is_count(double number) { return number >= 0.0 && number < 1e9 && number == (double)(int64_t)number; }

/* Counts the coefficients of the whole spline and of the part that is here; 0 if its boxes are invalid. */
static int count_spline(const mmv_field *field, size_t *all, size_t *here)
{
    double whole = 0.0, part = 0.0;
    for (size_t b = 0; b < field->box_count; ++b) {
        const double *box = field->boxes + 14 * b;
        double layers = 1.0, sent = 1.0;
        for (size_t axis = 0; axis < 3; ++axis) {
            double first = box[8 + axis], last = box[11 + axis];
            if (!is_count(box[4 + axis]) || !is_count(first) || !is_count(last) || first > last
                || last > layers_of(box, axis)) {
                return 0;
            }
            layers *= layers_of(box, axis);
            sent *= last - first;
        }
        if (!(box[7] == whole && layers < 1e9)) { /* one box after the other */
            return 0;
        }
        whole += layers;
        part += sent;
    }
    *all = (size_t)whole;
    *here = (size_t)part;
    return 1;
}

/* True if the arrays fit together; this is checked because they came over a network. */
static int is_whole(const mmv_field *field, int dimension)
{
    size_t centres = 0, rows = 0, all, here;
    for (size_t s = 0; s < field->sum_count; ++s) {
        if (field->sums[s].centres < 0 || (uint64_t)field->sums[s].centres > field->centre_count) {
            return 0;
        }
        centres += (size_t)field->sums[s].centres;
        rows += rows_of(&field->sums[s], dimension);
    }
    return centres == field->centre_count && count_spline(field, &all, &here)
           && rows + here == field->coefficient_count;
}

int mmv_knows_field(const mmv_volume *volume) { return volume && volume->field.sum_count > 0; }

int mmv_set_field(mmv_volume *volume, mmv_field field)
{
    mmv_field *own = &volume->field;
    size_t row = (size_t)volume->dimension * sizeof(double);
    if (field.sum_count == 0 && own->sum_count) {
        free(field.sums);
        free(field.centres);
        free(field.boxes);
        free(own->coefficients);
        own->coefficients = field.coefficients;
        own->coefficient_count = field.coefficient_count;
        return is_whole(own, volume->dimension) ? MESH_MOTION_OK : MESH_MOTION_INTERNAL;
    }
    if (!is_whole(&field, volume->dimension)) {
        free_field(&field);
        return MESH_MOTION_INTERNAL;
    }
    int is_known = is_same(own->sums, field.sums, own->sum_count, field.sum_count, sizeof *own->sums)
                   && is_same(own->centres, field.centres, own->centre_count, field.centre_count, row);
    if (!is_known) {
        free_near(volume);
    }
    free_field(own);
    *own = field;
    return MESH_MOTION_OK;
}

/* A sum with its weights, for this field. */
static int make_sum(const mmv_volume *volume, size_t s, const double *centres, const double *rows,
                    mesh_motion_interpolant **made)
{
    const mmv_sum *sum = &volume->field.sums[s];
    int d = volume->dimension;
    int result = mesh_motion_interpolant_create_on_grid(sum->basis, sum->radius, d, sum->origin, sum->inverse_side,
                                                        sum->extent, sum->shape, sum->centres, centres, d, rows, made);
    if (result == MESH_MOTION_OK && sum->has_polynomial) {
        result = mesh_motion_interpolant_set_polynomial(*made, sum->centre, sum->scale, rows + sum->centres * d);
    }
    return result;
}

static int is_compact(const mmv_sum *sum)
{
    return !sum->has_polynomial && (strncmp(sum->basis, "wendland-", 9) == 0 || strncmp(sum->basis, "ctps-", 5) == 0);
}

/* values += a sum. Data that do not depend on its weights are kept while fields have the same centres. */
static int add_sum(mmv_volume *volume, size_t s, const double *centres, const double *rows, double *values)
{
    const mmv_field *field = &volume->field;
    int64_t n = (int64_t)volume->nodes;
    int result = MESH_MOTION_OK;
    if (!volume->near) {
        volume->near = calloc(field->sum_count, sizeof *volume->near);
    }
    if (!volume->near) {
        return MESH_MOTION_OUT_OF_MEMORY;
    }
    if (!volume->near[s]) {
        mesh_motion_interpolant *sum = NULL;
        result = make_sum(volume, s, centres, rows, &sum);
        if (result == MESH_MOTION_OK && is_compact(&field->sums[s])) {
            result = mesh_motion_near_create(sum, n, volume->points, volume->is_uploaded, &volume->near[s]);
        } else if (result == MESH_MOTION_OK) {
            result = mesh_motion_interpolant_values(sum, n, volume->points, MESH_MOTION_ADD, values);
        }
        mesh_motion_interpolant_free(sum);
    }
    if (result == MESH_MOTION_OK && volume->near[s]) {
        result = mesh_motion_near_add(volume->near[s], volume->dimension, rows, values);
    }
    return result;
}

/* Copy the coefficients of this rank to or from their places among all coefficients. The nodes use no others. */
static void copy_coefficients(const mmv_field *field, size_t d, double *here, double *all, int to_all)
{
    for (size_t b = 0; b < field->box_count; ++b) {
        const double *box = field->boxes + 14 * b;
        size_t ny = (size_t)layers_of(box, 1), nz = (size_t)layers_of(box, 2), start = (size_t)box[7];
        size_t run = ((size_t)box[13] - (size_t)box[10]) * d;
        for (size_t x = (size_t)box[8]; x < (size_t)box[11]; ++x) {
            for (size_t y = (size_t)box[9]; y < (size_t)box[12]; ++y) {
                double *there = all + (start + (x * ny + y) * nz + (size_t)box[10]) * d;
                memcpy(to_all ? there : here, to_all ? here : there, run * sizeof *here);
                here += run;
            }
        }
    }
}

/* The spline of the coarse field: its arrays lie in columns. all (rows, dimension): all of its coefficients. */
static int make_spline(const mmv_volume *volume, size_t rows, const double *all, mesh_motion_spline **spline)
{
    const mmv_field *field = &volume->field;
    size_t count = field->box_count;
    double *origin = calloc(4 * count, sizeof *origin);
    int64_t *cells = calloc(4 * count, sizeof *cells);
    int result = origin && cells ? MESH_MOTION_OK : MESH_MOTION_OUT_OF_MEMORY;
    for (size_t b = 0; result == MESH_MOTION_OK && b < count; ++b) {
        const double *box = field->boxes + 14 * b;
        memcpy(origin + 3 * b, box, 3 * sizeof *box);
        origin[3 * count + b] = box[3];
        for (size_t axis = 0; axis < 3; ++axis) {
            cells[3 * b + axis] = (int64_t)box[4 + axis];
        }
        cells[3 * count + b] = (int64_t)box[7];
    }
    if (result == MESH_MOTION_OK) {
        result = mesh_motion_spline_create(volume->dimension, (int64_t)count, origin, origin + 3 * count, cells,
                                           cells + 3 * count, (int64_t)rows, volume->dimension, all, spline);
    }
    free(origin);
    free(cells);
    return result;
}

/* Write the values of the spline at the nodes; or, as transpose, write weights of its coefficients from weights of the
 * values. */
static int use_spline(const mmv_volume *volume, double *coefficients, const double *weights, double *values)
{
    const mmv_field *field = &volume->field;
    size_t rows = 0, here, d = (size_t)volume->dimension;
    int64_t n = (int64_t)volume->nodes;
    mesh_motion_spline *spline = NULL;
    (void)count_spline(field, &rows, &here); /* it is one, since is_whole */
    double *all = calloc(rows * d + 1, sizeof *all);
    if (!all) {
        return MESH_MOTION_OUT_OF_MEMORY;
    }
    if (!weights) {
        copy_coefficients(field, d, coefficients, all, 1);
    }
    int result = make_spline(volume, rows, all, &spline);
    if (result == MESH_MOTION_OK && weights) {
        result = mesh_motion_spline_counts(spline, n, volume->points, volume->dimension, weights, all);
        copy_coefficients(field, d, coefficients, all, 0);
    } else if (result == MESH_MOTION_OK) {
        result = mesh_motion_spline_values(spline, n, volume->points, MESH_MOTION_WRITE, values);
    }
    mesh_motion_spline_free(spline);
    free(all);
    return result;
}

/* Rows of coefficients of all sums; those of the spline come after them. */
static size_t rows_of_sums(const mmv_volume *volume)
{
    size_t rows = 0;
    for (size_t s = 0; s < volume->field.sum_count; ++s) {
        rows += rows_of(&volume->field.sums[s], volume->dimension);
    }
    return rows;
}

/* values (nodes, dimension) at the nodes, of the field with these coefficients. */
static int write_field(mmv_volume *volume, double *rows, double *values)
{
    const mmv_field *field = &volume->field;
    size_t d = (size_t)volume->dimension;
    const double *centres = field->centres;
    int result = MESH_MOTION_OK;
    if (field->box_count) {
        result = use_spline(volume, rows + rows_of_sums(volume) * d, NULL, values);
    } else {
        memset(values, 0, volume->nodes * d * sizeof *values);
    }
    for (size_t s = 0; result == MESH_MOTION_OK && s < field->sum_count; ++s) {
        if (s == 0 && !field->box_count) { /* the coarse field */
            mesh_motion_interpolant *sum = NULL;
            result = make_sum(volume, s, centres, rows, &sum);
            if (result == MESH_MOTION_OK) {
                result = mesh_motion_interpolant_values(sum, (int64_t)volume->nodes, volume->points,
                                                        MESH_MOTION_WRITE, values);
            }
            mesh_motion_interpolant_free(sum);
        } else {
            result = add_sum(volume, s, centres, rows, values);
        }
        centres += (size_t)field->sums[s].centres * d;
        rows += rows_of(&field->sums[s], volume->dimension) * d;
    }
    return result;
}

int mmv_displacement(mmv_volume *volume, const double *known, double *displacement)
{
    size_t d = (size_t)volume->dimension;
    int result = write_field(volume, volume->field.coefficients, displacement);
    for (size_t i = 0; result == MESH_MOTION_OK && i < volume->nodes * d; ++i) {
        double there = displacement[i] + volume->points[i]; /* rounded, as SPEC 23.5 says */
        displacement[i] = there - volume->points[i];
    }
    for (size_t row = 0; result == MESH_MOTION_OK && row < volume->uploaded_count; ++row) {
        memcpy(displacement + (size_t)volume->uploaded[row] * d, known + row * d, d * sizeof *known);
    }
    return result;
}

size_t mmv_coefficient_count(const mmv_volume *volume) { return volume->field.coefficient_count; }

int mmv_velocity(mmv_volume *volume, double *coefficients, const double *known, double *velocity)
{
    size_t d = (size_t)volume->dimension;
    int result = write_field(volume, coefficients, velocity);
    for (size_t row = 0; result == MESH_MOTION_OK && row < volume->uploaded_count; ++row) {
        memcpy(velocity + (size_t)volume->uploaded[row] * d, known + row * d, d * sizeof *known);
    }
    return result;
}

/* Weights of the coefficients of a sum's polynomial, from weights of its values: counts (dimension + 1, dimension). */
static void count_polynomial(const mmv_volume *volume, const mmv_sum *sum, const double *weights, double *counts)
{
    size_t d = (size_t)volume->dimension;
    memset(counts, 0, (d + 1) * d * sizeof *counts);
    for (size_t i = 0; i < volume->nodes; ++i) {
        for (size_t c = 0; c < d; ++c) {
            counts[c] += weights[i * d + c];
            for (size_t m = 0; m < d; ++m) {
                counts[(m + 1) * d + c] += (volume->points[i * d + m] - sum->centre[m]) / sum->scale * weights[i * d + c];
            }
        }
    }
}

int mmv_counts(const mmv_volume *volume, const double *weights, double *counts)
{
    const mmv_field *field = &volume->field;
    const double *centres = field->centres;
    size_t d = (size_t)volume->dimension;
    int result = MESH_MOTION_OK;
    for (size_t s = 0; result == MESH_MOTION_OK && s < field->sum_count; ++s) {
        const mmv_sum *sum = &field->sums[s];
        mesh_motion_interpolant *turned = NULL; /* its centres are the nodes: the basis depends on distances only */
        result = mesh_motion_interpolant_create(sum->basis, sum->radius, volume->dimension, (int64_t)volume->nodes,
                                                volume->points, volume->dimension, weights, &turned);
        if (result == MESH_MOTION_OK) {
            result = mesh_motion_interpolant_values(turned, sum->centres, centres, MESH_MOTION_WRITE, counts);
        }
        mesh_motion_interpolant_free(turned);
        if (sum->has_polynomial) {
            count_polynomial(volume, sum, weights, counts + (size_t)sum->centres * d);
        }
        centres += (size_t)sum->centres * d;
        counts += rows_of(sum, volume->dimension) * d;
    }
    return result == MESH_MOTION_OK && field->box_count ? use_spline(volume, counts, weights, NULL) : result;
}

static int have_tally(mmv_volume *volume, const char *metric)
{
    return volume->tally && strcmp(volume->metric, metric) == 0 ? MESH_MOTION_OK : make_tally(volume, metric);
}

typedef struct {
    int64_t id;
    size_t place;
} place;

static int by_id(const void *one, const void *other)
{
    const place *a = one, *b = other;
    return (a->id > b->id) - (a->id < b->id);
}

int mmv_find(const mmv_volume *volume, size_t count, const int64_t *ids, int64_t *nodes)
{
    place *asked = malloc((count + 1) * sizeof *asked);
    if (!asked) {
        return MESH_MOTION_OUT_OF_MEMORY;
    }
    for (size_t i = 0; i < count; ++i) {
        asked[i] = (place){ids[i], i};
        nodes[i] = -1;
    }
    qsort(asked, count, sizeof *asked, by_id);
    for (size_t node = 0; count && node < volume->nodes; ++node) {
        place own = {mmv_id_of(volume, (int64_t)node), 0};
        place *found = bsearch(&own, asked, count, sizeof own, by_id);
        if (found) {
            nodes[found->place] = (int64_t)node;
        }
    }
    free(asked);
    return MESH_MOTION_OK;
}

int mmv_region(mmv_volume *volume, const double *known, const char *metric, double below, int64_t rings, size_t around,
               const int64_t *ids, const mesh_motion_region **region, const double **positions)
{
    size_t d = (size_t)volume->dimension, here = 0;
    int64_t *nodes = malloc((around + 1) * sizeof *nodes);
    int by_corners = strcmp(metric, "corner-shape-size") == 0; /* relative to rest, like the tally */
    int result = nodes ? have_tally(volume, by_corners ? "relative-size-skew" : metric) : MESH_MOTION_OUT_OF_MEMORY;
    result = result == MESH_MOTION_OK ? mmv_find(volume, around, ids, nodes) : result;
    for (size_t i = 0; result == MESH_MOTION_OK && i < around; ++i) {
        if (nodes[i] >= 0) {
            nodes[here++] = nodes[i];
        }
    }
    result = result == MESH_MOTION_OK ? write_field(volume, volume->field.coefficients, volume->moved) : result;
    for (size_t i = 0; result == MESH_MOTION_OK && i < volume->nodes * d; ++i) {
        volume->moved[i] += volume->points[i];
    }
    for (size_t row = 0; result == MESH_MOTION_OK && row < volume->uploaded_count; ++row) {
        for (size_t axis = 0; axis < d; ++axis) {
            size_t at = (size_t)volume->uploaded[row] * d + axis;
            volume->moved[at] = volume->points[at] + known[row * d + axis];
        }
    }
    *positions = volume->moved;
    result = result == MESH_MOTION_OK ? mesh_motion_region_create(volume->tally, (int64_t)volume->nodes, volume->moved,
                                                                  metric, below, rings, (int64_t)here, nodes, region)
                                      : result;
    free(nodes);
    return result;
}

int mmv_judge(mmv_volume *volume, const double *displacement, const char *metric, mesh_motion_part *part)
{
    int result = have_tally(volume, metric);
    for (size_t i = 0; i < volume->nodes * (size_t)volume->dimension; ++i) {
        volume->moved[i] = volume->points[i] + displacement[i];
    }
    return result == MESH_MOTION_OK
               ? mesh_motion_tally_judge(volume->tally, (int64_t)volume->nodes, volume->moved, part)
               : result;
}

#else

typedef int mmv_not_built_in;

#endif
