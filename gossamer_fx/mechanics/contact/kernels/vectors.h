/* Products of vectors with three components. */
#ifndef GOSSAMER_VECTORS_H
#define GOSSAMER_VECTORS_H

#include <stddef.h>
#include <stdint.h>

static inline double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static inline void cross(const double *a, const double *b, double *product)
{
    product[0] = a[1] * b[2] - a[2] * b[1];
    product[1] = a[2] * b[0] - a[0] * b[2];
    product[2] = a[0] * b[1] - a[1] * b[0];
}

/* A row of an array (., 3) of points. */
static inline const double *point(const double *x,
                                  int32_t index) { return x + 3 * (ptrdiff_t)index; }

#endif
