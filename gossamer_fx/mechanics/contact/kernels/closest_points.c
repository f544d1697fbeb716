/* Closest points of pairs at one set of points, and bounds of how much closer pairs can come. */
#include "stencil.h"

void closest_points(const pair_list *pairs, const double *x, double *squared_distance,
                    double *parameters)
{
    for (ptrdiff_t i = 0; i < pairs->count; ++i) {
        const stencil *of = STENCILS + pairs->kind[i];
        const pair_vectors vectors = vectors_at(of->coefficients, x, pairs->points + 4 * i);
        squared_distance[i] = closest_distance(of, shape_of(pairs, i), &vectors, parameters + 2 * i);
    }
}

void approach_bounds(const pair_list *pairs, const double *x0, const double *x1, double *bound)
{
    for (ptrdiff_t i = 0; i < pairs->count; ++i) {
        const stencil *of = STENCILS + pairs->kind[i];
        const int32_t *points = pairs->points + 4 * i;
        bound[i] = is_boundary(of) ? INFINITY : approach_bound(of->first_count, x0, x1, points);
    }
}
