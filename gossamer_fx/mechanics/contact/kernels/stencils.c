/* The stencils of all kinds of pairs; see stencil.h.

   Of surfaces s is the squared distance of the closest points: the minimum over (u, v) of
   phi(u, v).e with phi = (1, 2u, 2v, u^2, 2uv, v^2).  A minimum of linear functions is concave, and
   ds/de = phi at the minimum.  Edges may be parallel, and their closest points then jump: epsilon
   ((u - 1/2)^2 + (v - 1/2)^2) is added to the form, which rounds s and leaves it concave.  Of walls s
   is the signed distance itself or minus a squared distance, concave as well. */
#include "closest_point.h"
#include "stencil.h"

/* ---- surfaces: a point and a triangle, two edges ---- */

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

/* |r + u a + v b|^2 with the rounding term. */
static inline double rounded_square(const pair_frame *frame, const pair_vectors *vectors, double u, double v)
{
    const double from_u = u - frame->corner[0] - 0.5, from_v = v - frame->corner[1] - 0.5;
    return squared_length_between(vectors, u, v) + frame->rounding * (from_u * from_u + from_v * from_v);
}

INLINED double closest_of_surfaces(int is_square, const pair_vectors *vectors, double parameters[2])
{
    const closest_point closest = closest_point_of_vectors(is_square, vectors);
    parameters[0] = closest.u;
    parameters[1] = closest.v;
    return squared_length_between(vectors, closest.u, closest.v);
}

INLINED double distance_of_surfaces(int is_square, const pair_frame *frame, const pair_vectors *vectors,
                                    double gradient[6])
{
    double measures[6];
    measures_of(vectors, measures);
    if (is_square) add_rounding(frame, measures);
    const closest_point closest = closest_point_of_measures(is_square, measures, frame->corner);
    distance_weights(closest.u, closest.v, gradient);
    return rounded_square(frame, vectors, closest.u, closest.v);
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

/* The closest points move with e in each direction in which they are free, and s then bends by the
   square of that over the form's curvature. */
INLINED void derivatives_of_surfaces(int is_square, const pair_frame *frame, const double measures[6],
                                     double gradient[6], double (*hessian)[6], double weight)
{
    double rounded[6];
    memcpy(rounded, measures, sizeof rounded);
    if (is_square) add_rounding(frame, rounded);
    const closest_point closest = closest_point_of_measures(is_square, rounded, frame->corner);
    distance_weights(closest.u, closest.v, gradient);
    if (!hessian || closest.curvature <= 0) return;
    add_free_direction(&closest, closest.direction[0], closest.direction[1], closest.curvature,
                       weight, hessian);
    if (closest.last_curvature <= 0) return;
    add_free_direction(&closest, -closest.shear, 1, closest.last_curvature, weight, hessian);
}

static double length_of_square(double s) { return sqrt(s > 0 ? s : 0); }

static double closest_of_triangle(const pair_vectors *vectors, double shape, double parameters[2])
{
    (void)shape;
    return closest_of_surfaces(0, vectors, parameters);
}

static double distance_of_triangle(const pair_frame *frame, const pair_vectors *vectors, double gradient[6])
{
    return distance_of_surfaces(0, frame, vectors, gradient);
}

static void derivatives_of_triangle(const pair_frame *frame, const double measures[6], double gradient[6],
                                    double (*hessian)[6], double weight)
{
    derivatives_of_surfaces(0, frame, measures, gradient, hessian, weight);
}

static double closest_of_edges(const pair_vectors *vectors, double shape, double parameters[2])
{
    (void)shape;
    return closest_of_surfaces(1, vectors, parameters);
}

static double distance_of_edges(const pair_frame *frame, const pair_vectors *vectors, double gradient[6])
{
    return distance_of_surfaces(1, frame, vectors, gradient);
}

static void derivatives_of_edges(const pair_frame *frame, const double measures[6], double gradient[6],
                                 double (*hessian)[6], double weight)
{
    derivatives_of_surfaces(1, frame, measures, gradient, hessian, weight);
}

/* ---- walls: s of the measures, and its derivatives; see `wall` of a stencil ---- */

static double length_of_distance(double s) { return s; }

/* In a room s is minus a squared distance from the middle. */
static double length_in_room(double s) { return -sqrt(-s); }

static double plane(double shape, const double measures[6], double gradient[6], double (*hessian)[6],
                    double weight)
{
    (void)shape, (void)hessian, (void)weight;
    gradient[1] = 1;
    return measures[1];
}

static double inside_sphere(double shape, const double measures[6], double gradient[6],
                            double (*hessian)[6], double weight)
{
    (void)shape, (void)hessian, (void)weight;
    gradient[0] = -1;
    return -measures[0];
}

static double inside_cylinder(double shape, const double measures[6], double gradient[6],
                              double (*hessian)[6], double weight)
{
    (void)shape;
    gradient[1] = -2 * measures[1];
    gradient[2] = -2 * measures[2];
    if (hessian) {
        hessian[1][1] -= 2 * weight;
        hessian[2][2] -= 2 * weight;
    }
    return -measures[1] * measures[1] - measures[2] * measures[2];
}

/* ---- all kinds; the row is the number of the kind ---- */

const stencil STENCILS[] = {
    {.name = "POINT_TRIANGLE",
     .coefficients = {{1, -1, 0, 0}, {0, 1, -1, 0}, {0, 1, 0, -1}},
     .first_count = 1,
     .closest = closest_of_triangle,
     .distance = distance_of_triangle,
     .derivatives = derivatives_of_triangle,
     .length_of = length_of_square},
    {.name = "EDGE_EDGE",
     .coefficients = {{1, 0, -1, 0}, {-1, 1, 0, 0}, {0, 0, 1, -1}},
     .first_count = 2,
     .is_rounded = 1,
     .closest = closest_of_edges,
     .distance = distance_of_edges,
     .derivatives = derivatives_of_edges,
     .length_of = length_of_square},
    {.name = "POINT_PLANE",
     .coefficients = {{1, -1, 0, 0}, {0, 0, 1, 0}, {0, 0, 0, 0}},
     .first_count = 1,
     .wall = plane,
     .is_linear = 1,
     .length_of = length_of_distance},
    {.name = "POINT_IN_SPHERE",
     .coefficients = {{1, -1, 0, 0}, {0, 0, 0, 0}, {0, 0, 0, 0}},
     .first_count = 1,
     .wall = inside_sphere,
     .is_linear = 1,
     .length_of = length_in_room},
    {.name = "POINT_IN_CYLINDER",
     .coefficients = {{1, -1, 0, 0}, {0, 0, 1, 0}, {0, 0, 0, 1}},
     .first_count = 1,
     .wall = inside_cylinder,
     .is_linear = 1,
     .length_of = length_in_room},
};

int kind_count(void) { return (int)(sizeof STENCILS / sizeof *STENCILS); }

const char *kind_name(int kind) { return STENCILS[kind].name; }
