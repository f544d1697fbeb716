/* Closest points of pairs at one set of points, and bounds of how much closer pairs can come. */
#include "closest_point.h"

static double squared_distance_of_wall(int kind, const pair_vectors *vectors)
{
    const double *r = vectors->row[0];
    if (kind == POINT_PLANE) return dot(r, vectors->row[1]);
    if (kind == POINT_IN_SPHERE) return -dot(r, r);
    const double along_first = dot(r, vectors->row[1]), along_second = dot(r, vectors->row[2]);
    return -along_first * along_first - along_second * along_second;
}

void closest_points(const pair_list *pairs, const double *x, double *squared_distance,
                    double *parameters)
{
    for (ptrdiff_t i = 0; i < pairs->count; ++i) {
        const int kind = pairs->kind[i];
        const pair_vectors vectors = vectors_at(PAIR_COEFFICIENTS[kind], x, pairs->points + 4 * i);
        double u = 0, v = 0;
        if (is_wall(kind)) squared_distance[i] = squared_distance_of_wall(kind, &vectors);
        else {
            const closest_point closest = closest_point_of_vectors(kind, &vectors);
            u = closest.u;
            v = closest.v;
            squared_distance[i] = squared_length_between(&vectors, u, v);
        }
        if (!parameters) continue;
        parameters[2 * i] = u;
        parameters[2 * i + 1] = v;
    }
}

void approach_bounds(const pair_list *pairs, const double *x0, const double *x1, double *bound)
{
    for (ptrdiff_t i = 0; i < pairs->count; ++i) {
        const int kind = pairs->kind[i];
        bound[i] = is_wall(kind) ? INFINITY : approach_bound(kind, x0, x1, pairs->points + 4 * i);
    }
}
