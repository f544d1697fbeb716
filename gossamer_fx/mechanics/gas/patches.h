/* Ring kernel: the gradient of the volume that the strips of a ring close, and its derivative; see
   gas/ring.py, (1) to (3).

   The C compiler reads this file, and so does cffi, without the preprocessor's lines
   (forms/c_source.py).  Python checks lengths, types and writability of all arrays, and the range
   of all indices, before it calls a function. Shapes stand in brackets; arrays are stored row by
   row.

   n strips of a ring with m nodes; k nodes of a strip; g quadrature points of a strip.  Lengths in
   metres. */
#ifndef GOSSAMER_RING_H
#define GOSSAMER_RING_H

#include <stddef.h>
#include <stdint.h>

typedef struct {
    ptrdiff_t strip_count;  /* n */
    ptrdiff_t node_count;   /* k */
    ptrdiff_t point_count;  /* g */
    const int32_t *nodes;   /* (n, k) nodes of each strip */
    const double *along;    /* (g, k) derivatives of the nodes' functions along the strip */
    const double *across;   /* (g, k) derivatives across the strip */
    const double *test;     /* (g, k) values of the functions times the weight of the point */
} ring_strips;

/* Rows of the tangent, each of one node of a strip. */
typedef struct {
    ptrdiff_t count;        /* r */
    const int32_t *strip;   /* (r) */
    const int32_t *node;    /* (r) below k */
} ring_rows;

/* Add G of (2) at the positions x (m, 3) to the gradient (m, 3) [m^2]. */
void add_ring_gradient(const ring_strips *ring, const double *x, double *gradient);

/* Set the blocks (r, 3, 3 k) to scale times the derivative of G of each row by the nodes of its
   strip, at x (m, 3). */
void ring_tangent(const ring_strips *ring, const ring_rows *rows, const double *x, double scale,
                  double *blocks);

#endif
