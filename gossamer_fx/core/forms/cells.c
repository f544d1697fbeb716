/* Loops of compiled functions over the cells of a mesh: see cells.h. */
#include "cells.h"

#include <string.h>

/* The functions that FFCx makes have an argument more from version 0.10 on. */
#ifdef KERNELS_TAKE_DATA
typedef void (*tabulate)(double *, const double *, const double *, const double *, const int *,
                         const uint8_t *, void *);
#define NO_DATA , NULL
#else
typedef void (*tabulate)(double *, const double *, const double *, const double *, const int *,
                         const uint8_t *);
#define NO_DATA
#endif

/* Copy the values in one cell to an array, and return its end. */
static inline double *gather(const cell_values *from, ptrdiff_t cell, double *restrict to)
{
    const ptrdiff_t size = from->size;
    const int32_t *nodes = from->nodes + cell * from->node_count;
    const double *all = from->values;
    if (size == 3) {
        /* Positions and strains: a loop of unknown length would take twice the time. */
        for (ptrdiff_t k = 0; k < from->node_count; k++, to += 3) {
            const double *values = all + nodes[k] * (ptrdiff_t)3;
            to[0] = values[0];
            to[1] = values[1];
            to[2] = values[2];
        }
        return to;
    }
    for (ptrdiff_t k = 0; k < from->node_count; k++) {
        const double *values = all + nodes[k] * size;
        for (ptrdiff_t i = 0; i < size; i++) *to++ = values[i];
    }
    return to;
}

/* Take the present values of a function's constants, before it is called in the first cell. */
static void read_constants(const cell_function *f)
{
    double *to = f->constants;
    for (ptrdiff_t k = 0; k < f->source_count; k++)
        for (ptrdiff_t i = 0; i < f->sources[k].count; i++) *to++ = f->sources[k].values[i];
}

/* Evaluate a function in one cell: values (value_count). */
static void call(const cell_function *f, const cell_set *cells, ptrdiff_t cell, double *values,
                 ptrdiff_t value_count)
{
    double *end = f->packed;
    for (ptrdiff_t i = 0; i < f->argument_count; i++) end = gather(f->arguments + i, cell, end);
    gather(&cells->corners, cell, cells->x);
    /* Functions of FFCx add to what is there. */
    memset(values, 0, (size_t)value_count * sizeof(double));
    ((tabulate)f->function)(values, f->packed, f->constants, cells->x, NULL, NULL NO_DATA);
}

/* Set the values in one cell. */
static inline void set_in_cell(const cell_values *to, ptrdiff_t cell, const double *values)
{
    const int32_t *nodes = to->nodes + cell * to->node_count;
    for (ptrdiff_t k = 0; k < to->node_count; k++) {
        double *row = to->values + nodes[k] * to->size;
        for (ptrdiff_t i = 0; i < to->size; i++) row[i] = *values++;
    }
}

void set_in_cells(const cell_function *f, const cell_set *cells, const cell_values *to,
                  double *work)
{
    read_constants(f);
    for (ptrdiff_t cell = 0; cell < cells->count; cell++) {
        call(f, cells, cell, work, to->node_count * to->size);
        set_in_cell(to, cell, work);
    }
}

void add_in_cells(const cell_function *f, const cell_set *cells, const cell_values *to,
                  double *work)
{
    read_constants(f);
    for (ptrdiff_t cell = 0; cell < cells->count; cell++) {
        call(f, cells, cell, work, to->node_count * to->size);
        const double *added = work;
        const int32_t *nodes = to->nodes + cell * to->node_count;
        for (ptrdiff_t k = 0; k < to->node_count; k++) {
            double *row = to->values + nodes[k] * to->size;
            for (ptrdiff_t i = 0; i < to->size; i++) row[i] += *added++;
        }
    }
}

/* PETSc's MatSetValuesBlocked with 32 bits for an index, and its ADD_VALUES. */
typedef int (*set_values)(void *, int32_t, const int32_t *, int32_t, const int32_t *,
                          const double *, int);
enum { ADD = 2 };

/* Add one block of a row-major matrix of some width to a block that is stored by columns. */
static inline void add_block(double *block, const double *entries, ptrdiff_t width, ptrdiff_t size)
{
    for (ptrdiff_t i = 0; i < size; i++)
        for (ptrdiff_t j = 0; j < size; j++) block[j * size + i] += entries[i * width + j];
}

int add_to_blocks(const cell_function *f, const cell_set *cells, const block_matrix *to,
                  double *work)
{
    const ptrdiff_t size = to->size;
    const ptrdiff_t k = to->node_count;
    const ptrdiff_t width = k * size;
    read_constants(f);
    for (ptrdiff_t cell = 0; cell < cells->count; cell++) {
        call(f, cells, cell, work, width * width);
        const int32_t *positions = to->positions + cell * k * k;
        if (positions[0] < 0) {
            const int32_t *rows = to->rows + cell * k;
            const int error = ((set_values)to->set_values)(
                (void *)to->matrix, (int32_t)k, rows, (int32_t)k, rows, work, ADD);
            if (error) return error;
            continue;
        }
        for (ptrdiff_t i = 0; i < k; i++)
            for (ptrdiff_t j = 0; j < k; j++) {
                double *block = to->values + positions[i * k + j] * size * size;
                const double *entries = work + i * size * width + j * size;
                /* The compiler unrolls loops of known length. */
                if (size == 3) add_block(block, entries, width, 3);
                else add_block(block, entries, width, size);
            }
    }
    return 0;
}

void add_at_positions(const double *blocks, const int32_t *positions, ptrdiff_t count,
                      double *matrix)
{
    for (ptrdiff_t k = 0; k < count; k++)
        for (int i = 0; i < 9; i++) matrix[positions[k] * (ptrdiff_t)9 + i] += blocks[9 * k + i];
}
