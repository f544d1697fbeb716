/* Edges that intersect triangles, as far as double precision can tell; intersections.py decides the
   rest exactly. */
#include <float.h>
#include <math.h>

#include "contact.h"
#include "vectors.h"

/* A computed volume is off by less than this multiple of epsilon times the sum of its terms' sizes:
   Shewchuk, "Adaptive precision floating-point arithmetic and fast robust geometric predicates",
   Discrete Comput. Geom. 18 (1997) 305, section 4.2, doi:10.1007/PL00009321. */
static const double ERROR_BOUND = 8 * DBL_EPSILON;

/* Three of the volume's six products: u_i (v_j w_k - v_k w_j); their sizes are added to `size`. */
static double products_of_volume(const double *u, const double *v, const double *w, int i,
                                 double *size)
{
    const int j = (i + 1) % 3, k = (i + 2) % 3;
    const double first = v[j] * w[k], second = v[k] * w[j];
    *size += fabs(u[i]) * (fabs(first) + fabs(second));
    return u[i] * (first - second);
}

/* Sign of the volume (b - a) x (c - a) . (d - a); UNSURE where round-off may hide it. */
static int side_of_plane(const double *a, const double *b, const double *c, const double *d)
{
    double u[3], v[3], w[3], size = 0, volume = 0;
    for (int k = 0; k < 3; ++k) {
        u[k] = b[k] - a[k];
        v[k] = c[k] - a[k];
        w[k] = d[k] - a[k];
    }
    for (int i = 0; i < 3; ++i) volume += products_of_volume(u, v, w, i, &size);
    if (size == 0) return 0;
    if (fabs(volume) <= ERROR_BOUND * size) return UNSURE;
    return volume > 0 ? 1 : -1;
}

/* An edge intersects a triangle if its ends lie on both sides of the plane, and its line turns the
   same way about the three sides. */
static enum intersection intersection_of(const double *start, const double *end,
                                         const double *const corners[3])
{
    const int below = side_of_plane(corners[0], corners[1], corners[2], start);
    const int above = side_of_plane(corners[0], corners[1], corners[2], end);
    enum intersection found = below == UNSURE || above == UNSURE ? UNSURE : INTERSECTS;
    if (found == INTERSECTS && below * above >= 0) return SEPARATE;
    int turn = UNSURE;
    for (int k = 0; k < 3; ++k) {
        const int side = side_of_plane(start, end, corners[k], corners[(k + 1) % 3]);
        if (side == UNSURE) {
            found = UNSURE;
            continue;
        }
        if (side == 0 || (turn != UNSURE && side != turn)) return SEPARATE;
        turn = side;
    }
    return found;
}

void find_intersections(const edge_triangle_pairs *candidates, uint8_t *found)
{
    for (ptrdiff_t i = 0; i < candidates->count; ++i) {
        const int32_t *edge = candidates->edges + 2 * (ptrdiff_t)candidates->pairs[2 * i];
        const int32_t *triangle = candidates->triangles + 3 * (ptrdiff_t)candidates->pairs[2 * i + 1];
        const double *corners[3];
        for (int k = 0; k < 3; ++k) corners[k] = point(candidates->x, triangle[k]);
        found[i] = (uint8_t)intersection_of(point(candidates->x, edge[0]), point(candidates->x,
                                                                                 edge[1]), corners);
    }
}
