/* Loops of compiled functions over the cells of a mesh.

   The C compiler reads this file, and so does cffi, without the preprocessor's lines
   (forms/c_source.py).  Python checks lengths, types and writability of all arrays, and the range
   of all indices, before it calls a function. Shapes stand in brackets; arrays are stored row by
   row; c is the number of cells. */
#ifndef GOSSAMER_CELLS_H
#define GOSSAMER_CELLS_H

#include <stddef.h>
#include <stdint.h>

/* The values of a function in the cells. */
typedef struct {
    double *values;        /* (rows, size) at the nodes or points of its space */
    const int32_t *nodes;  /* (c, node_count) their rows */
    ptrdiff_t node_count;
    ptrdiff_t size;
} cell_values;

typedef struct {
    ptrdiff_t count;       /* c */
    cell_values corners;   /* coordinates of the nodes of the geometry */
    double *x;             /* (corners.node_count, 3) work */
} cell_set;

/* A number or an array that is the same in all cells, and may change between calls. */
typedef struct {
    const double *values;
    ptrdiff_t count;
} constant_value;

/* A compiled function of the values in one cell, with the signature that FFCx gives to expressions
   and integrals. */
typedef struct {
    uintptr_t function;
    double *constants;     /* work: the present values of all sources, one after the other */
    ptrdiff_t source_count;
    const constant_value *sources;
    ptrdiff_t argument_count;
    const cell_values *arguments;
    double *packed;        /* (sum of node_count size) work: the arguments in one cell */
} cell_function;

/* Set the values in all cells to those of a function; work (values of one cell). */
void set_in_cells(const cell_function *f, const cell_set *cells, const cell_values *to,
                  double *work);

/* Add the values of a function in all cells, as an assembly does; work (values of one cell). */
void add_in_cells(const cell_function *f, const cell_set *cells, const cell_values *to,
                  double *work);

/* Blocks of a matrix, of which this rank owns some rows and columns; k is node_count. */
typedef struct {
    ptrdiff_t size;            /* unknowns of a node */
    ptrdiff_t node_count;
    double *values;            /* (blocks, size, size), each block column by column */
    const int32_t *positions;  /* (c, k, k) the block of two nodes; the first is -1 in a cell with
                                  nodes of other ranks */
    const int32_t *rows;       /* (c, k) numbers of the nodes in the matrix */
    uintptr_t matrix;          /* PETSc's matrix, and MatSetValuesBlocked */
    uintptr_t set_values;
} block_matrix;

/* Add the values of a function of pairs of nodes in all cells, work (values of one cell); returns
   PETSc's number of an error, or zero. */
int add_to_blocks(const cell_function *f, const cell_set *cells, const block_matrix *to,
                  double *work);

/* Add blocks (count, 3, 3) to those of a matrix (blocks, 3, 3) at some positions (count). */
void add_at_positions(const double *blocks, const int32_t *positions, ptrdiff_t count,
                      double *matrix);

#endif
