/* The gradient of the volume that the strips of a ring close, and its derivative.  See ring.h. */
#include "ring.h"

#include <string.h>

/* The tangent x,s or x,r of a strip at a point, from the derivatives (k) of its nodes' functions
   there. */
static void tangent_at(const ring_strips *ring, const int32_t *nodes, const double *slopes,
                       const double *x,
                       double *tangent)
{
    tangent[0] = tangent[1] = tangent[2] = 0;
    for (ptrdiff_t j = 0; j < ring->node_count; ++j) {
        const double *position = x + 3 * (ptrdiff_t)nodes[j];
        for (int c = 0; c < 3; ++c) tangent[c] += slopes[j] * position[c];
    }
}

static void cross(const double *a, const double *b, double *product)
{
    product[0] = a[1] * b[2] - a[2] * b[1];
    product[1] = a[2] * b[0] - a[0] * b[2];
    product[2] = a[0] * b[1] - a[1] * b[0];
}

void add_ring_gradient(const ring_strips *ring, const double *x, double *gradient)
{
    const ptrdiff_t k = ring->node_count;
    for (ptrdiff_t strip = 0; strip < ring->strip_count; ++strip) {
        const int32_t *nodes = ring->nodes + strip * k;
        for (ptrdiff_t point = 0; point < ring->point_count; ++point) {
            double along[3], across[3], normal[3];
            tangent_at(ring, nodes, ring->along + point * k, x, along);
            tangent_at(ring, nodes, ring->across + point * k, x, across);
            cross(along, across, normal);
            for (ptrdiff_t i = 0; i < k; ++i)
                for (int c = 0; c < 3; ++c)
                    gradient[3 * (ptrdiff_t)nodes[i] + c] += ring->test[point * k + i] * normal[c];
        }
    }
}

/* Add the cross product with a vector, as a matrix, to the columns of a node in the three rows of a
   block. */
static void add_cross_matrix(const double *a, ptrdiff_t width, double *columns)
{
    columns[1] -= a[2];
    columns[2] += a[1];
    columns[width] += a[2];
    columns[width + 2] -= a[0];
    columns[2 * width] -= a[1];
    columns[2 * width + 1] += a[0];
}

void ring_tangent(const ring_strips *ring, const ring_rows *rows, const double *x, double scale,
                  double *blocks)
{
    const ptrdiff_t k = ring->node_count;
    const ptrdiff_t width = 3 * k;
    memset(blocks, 0, (size_t)(rows->count * 3 * width) * sizeof *blocks);
    for (ptrdiff_t row = 0; row < rows->count; ++row) {
        const int32_t *nodes = ring->nodes + rows->strip[row] * k;
        double *block = blocks + row * 3 * width;
        for (ptrdiff_t point = 0; point < ring->point_count; ++point) {
            double along[3], across[3];
            const double *slopes_along = ring->along + point * k;
            const double *slopes_across = ring->across + point * k;
            tangent_at(ring, nodes, slopes_along, x, along);
            tangent_at(ring, nodes, slopes_across, x, across);
            const double weight = scale * ring->test[point * k + rows->node[row]];
            for (ptrdiff_t j = 0; j < k; ++j) {
                /* x,s x dx,r - x,r x dx,s = a x dx with the derivatives of node j's function. */
                double a[3];
                for (int c = 0; c < 3; ++c)
                    a[c] = weight * (slopes_across[j] * along[c] - slopes_along[j] * across[c]);
                add_cross_matrix(a, width, block + 3 * j);
            }
        }
    }
}
