/* The squared distance s(e) of a pair as a concave function of its six measures e, and its
   derivatives.

   s is the minimum over (u, v) of phi(u, v).e with phi = (1, 2u, 2v, u^2, 2uv, v^2), a minimum of
   linear functions, so concave, and ds/de = phi at the minimum.  Edges may be parallel, and their
   closest points then jump: epsilon ((u - 1/2)^2 + (v - 1/2)^2) is added to the form, which rounds
   s and leaves it concave.  Of walls s is the signed distance itself or minus a squared distance:
   see contact.h. */
#ifndef GOSSAMER_PAIR_DISTANCE_H
#define GOSSAMER_PAIR_DISTANCE_H

#include "closest_point.h"

/* Add the measures of the rounding term; its (u, v) count from the middle of both edges. */
static inline void add_rounding(const pair_frame *frame, double measures[6])
{
    if (frame->rounding == 0) return;
    const double u = -frame->corner[0] - 0.5, v = -frame->corner[1] - 0.5;
    measures[0] += frame->rounding * (u * u + v * v);
    measures[1] += frame->rounding * u;
    measures[2] += frame->rounding * v;
    measures[3] += frame->rounding;
    measures[5] += frame->rounding;
}

/* phi(u, v) */
static inline void distance_weights(double u, double v, double weights[6])
{
    weights[0] = 1;
    weights[1] = 2 * u;
    weights[2] = 2 * v;
    weights[3] = u * u;
    weights[4] = 2 * u * v;
    weights[5] = v * v;
}

/* s at some vectors, and its gradient ds/de. */
static inline double pair_distance(const pair_frame *frame, const pair_vectors *vectors,
                                   double gradient[6])
{
    const double *r = vectors->row[0];
    memset(gradient, 0, 6 * sizeof *gradient);
    if (frame->kind == POINT_PLANE) {
        gradient[1] = 1;
        return dot(r, vectors->row[1]);
    }
    if (frame->kind == POINT_IN_SPHERE) {
        gradient[0] = -1;
        return -dot(r, r);
    }
    if (frame->kind == POINT_IN_CYLINDER) {
        const double along_first = dot(r, vectors->row[1]), along_second = dot(r, vectors->row[2]);
        gradient[1] = -2 * along_first;
        gradient[2] = -2 * along_second;
        return -along_first * along_first - along_second * along_second;
    }
    double measures[6];
    measures_of(vectors, measures);
    add_rounding(frame, measures);
    const closest_point closest = closest_point_of_measures(frame->kind, measures, frame->corner);
    distance_weights(closest.u, closest.v, gradient);
    const double u = closest.u - frame->corner[0] - 0.5, v = closest.v - frame->corner[1] - 0.5;
    return squared_length_between(vectors, closest.u,
                                  closest.v) + frame->rounding * (u * u + v * v);
}

/* hessian -= weight q q^T/curvature, with the derivative q = dphi/du du + dphi/dv dv along a free
   direction */
static inline void add_free_direction(const closest_point *closest, double du, double dv,
                                      double curvature,
                                      double weight, double hessian[6][6])
{
    const double u = closest->u, v = closest->v;
    const double by_u[6] = {0, 2, 0, 2 * u, 2 * v, 0}, by_v[6] = {0, 0, 2, 0, 2 * u, 2 * v};
    double q[6];
    for (int m = 0; m < 6; ++m) q[m] = du * by_u[m] + dv * by_v[m];
    for (int m = 0; m < 6; ++m)
        for (int k = 0; k < 6; ++k) hessian[m][k] -= weight * q[m] * q[k] / curvature;
}

/* ds/de at some measures; if `hessian` is not NULL, weight times d2s/de2 is added to it.  The
   closest points move with e in each direction in which they are free, and s then bends by the
   square of that over the form's curvature. */
static inline void distance_derivatives(const pair_frame *frame, const double measures[6],
                                        double gradient[6],
                                        double (*hessian)[6], double weight)
{
    memset(gradient, 0, 6 * sizeof *gradient);
    if (frame->kind == POINT_PLANE) {
        gradient[1] = 1;
        return;
    }
    if (frame->kind == POINT_IN_SPHERE) {
        gradient[0] = -1;
        return;
    }
    if (frame->kind == POINT_IN_CYLINDER) {
        gradient[1] = -2 * measures[1];
        gradient[2] = -2 * measures[2];
        if (!hessian) return;
        hessian[1][1] -= 2 * weight;
        hessian[2][2] -= 2 * weight;
        return;
    }
    double rounded[6];
    memcpy(rounded, measures, sizeof rounded);
    add_rounding(frame, rounded);
    const closest_point closest = closest_point_of_measures(frame->kind, rounded, frame->corner);
    distance_weights(closest.u, closest.v, gradient);
    if (!hessian || closest.curvature <= 0) return;
    add_free_direction(&closest, closest.direction[0], closest.direction[1], closest.curvature,
                       weight, hessian);
    if (closest.last_curvature <= 0) return;
    add_free_direction(&closest, -closest.shear, 1, closest.last_curvature, weight, hessian);
}

#endif
