/* The stencils of all kinds of pairs; see stencil.h.

   Of surfaces s is the squared distance of the closest points: the minimum over (u, v) of
   phi(u, v).e with phi = (1, 2u, 2v, u^2, 2uv, v^2).  A minimum of linear functions is concave, and
   ds/de = phi at the minimum.  Edges may be parallel, and their closest points then jump: epsilon
   ((u - 1/2)^2 + (v - 1/2)^2) is added to the form, which rounds s and leaves it concave.  Of boundaries
   s is the signed distance itself or minus a squared distance, concave as well. */
#include "closest_point.h"
#include "stencil.h"

/* Of a distance [m], by which derivatives are divided. */
static const double SHORTEST_LENGTH = 1e-100;

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
static inline double rounded_square(const pair_frame *frame, const pair_vectors *vectors,
                                    double u, double v)
{
    const double from_u = u - frame->corner[0] - 0.5, from_v = v - frame->corner[1] - 0.5;
    const double rounding = frame->rounding * (from_u * from_u + from_v * from_v);
    return squared_length_between(vectors, u, v) + rounding;
}

INLINED double closest_of_surfaces(int is_square, const pair_vectors *vectors, double parameters[2])
{
    const closest_point closest = closest_point_of_vectors(is_square, vectors);
    parameters[0] = closest.u;
    parameters[1] = closest.v;
    return squared_length_between(vectors, closest.u, closest.v);
}

INLINED double distance_of_surfaces(int is_square, const pair_frame *frame,
                                    const pair_vectors *vectors,
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
INLINED void derivatives_of_surfaces(int is_square, const pair_frame *frame,
                                     const double measures[6],
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

static double distance_of_triangle(const pair_frame *frame, const pair_vectors *vectors,
                                   double gradient[6])
{
    return distance_of_surfaces(0, frame, vectors, gradient);
}

static void derivatives_of_triangle(const pair_frame *frame, const double measures[6],
                                    double gradient[6],
                                    double (*hessian)[6], double weight)
{
    derivatives_of_surfaces(0, frame, measures, gradient, hessian, weight);
}

static double closest_of_edges(const pair_vectors *vectors, double shape, double parameters[2])
{
    (void)shape;
    return closest_of_surfaces(1, vectors, parameters);
}

static double distance_of_edges(const pair_frame *frame, const pair_vectors *vectors,
                                double gradient[6])
{
    return distance_of_surfaces(1, frame, vectors, gradient);
}

static void derivatives_of_edges(const pair_frame *frame, const double measures[6],
                                 double gradient[6],
                                 double (*hessian)[6], double weight)
{
    derivatives_of_surfaces(1, frame, measures, gradient, hessian, weight);
}

/* ---- boundaries: s of the measures, and its derivatives; see `boundary` of a stencil ---- */

static double length_of_distance(double s) { return s; }

/* In a room s is minus a squared distance from the middle. */
static double length_in_room(double s) { return -sqrt(-s); }

static double plane(double shape, const double measures[6], double gradient[6],
                    double (*hessian)[6],
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

/* ---- an edge and a cone: s is the distance from balls along the axis, (1) of cone.py ---- */

/* The square |r + u a + v b|^2, with the rounding of the measures if there are no vectors. */
INLINED double square_at(const distance_form *form, double u, double v)
{
    if (form->vectors) return squared_length_between(form->vectors, u, v);
    const double *e = form->measures;
    return e[0] + u * (2 * e[1] + u * e[3] + 2 * v * e[4]) + v * (2 * e[2] + v * e[5]);
}

/* By how much the minimum of sqrt(square + curvature w^2) - taper w is beyond w = 0; infinite if
   there is none. */
static inline double shift_of_taper(double taper, double square, double curvature)
{
    if (taper == 0 && curvature > 0) return 0;
    if (!(curvature > taper * taper)) return taper > 0 ? INFINITY : -INFINITY;
    return taper * sqrt((square > 0 ? square : 0) / (curvature * (curvature - taper * taper)));
}

/* Set `found` to the closest point of one side of the square, if its distance is below `best`. */
INLINED void closest_on_tapered_side(const distance_form *form, const domain_side *side,
                                     double taper,
                                     double *best, closest_point *found)
{
    const double *e = form->measures;
    const double du = side->du, dv = side->dv;
    const double u = form->corner[0] + side->u, v = form->corner[1] + side->v;
    const double curvature = du * du * e[3] + dv * dv * e[5];
    const double slope = du * (e[1] + u * e[3] + v * e[4]) + dv * (e[2] + u * e[4] + v * e[5]);
    const double foot = curvature > 0 ? -slope / curvature : 0;
    const double square = square_at(form, u + foot * du, v + foot * dv);
    const double t = clip_to_unit(foot + shift_of_taper(dv * taper, square, curvature));
    const double distance = sqrt(fmax(square_at(form, u + t * du, v + t * dv), 0)) -
        taper * (side->v + t * dv);
    if (!(distance < *best)) return;
    *best = distance;
    found->u = u + t * du;
    found->v = v + t * dv;
    found->direction[0] = du;
    found->direction[1] = dv;
    found->curvature = t > 0 && t < 1;
}

/* The closest point of an edge and a cone.  `curvature` and `last_curvature` of the result only say
   whether it is free along the first and the second direction. */
INLINED closest_point closest_tapered_point(const distance_form *form, double taper)
{
    const double *e = form->measures;
    closest_point found = {0};
    double u = 0, v = 0, best = INFINITY;
    const double det = interior_minimum(form, &u, &v);
    if (det > SAFE_SINE_SQUARED * e[3] * e[5]) {
        const double shift = shift_of_taper(taper, square_at(form, u, v), det / e[3]);
        v += shift;
        u -= shift * e[4] / e[3];
        if (is_in_domain(1, u - form->corner[0], v - form->corner[1]))
            return (closest_point){.u = u, .v = v, .direction = {1, 0}, .curvature = 1,
                                   .shear = e[4] / e[3],
                                   .last_curvature = 1};
    }
    for (int i = 0; i < 4; ++i)
        closest_on_tapered_side(form, SQUARE_SIDES + i, taper, &best, &found);
    return found;
}

static double closest_of_cone(const pair_vectors *vectors, double taper, double parameters[2])
{
    distance_form form = {.vectors = vectors, .corner = {0, 0}, .is_square = 1};
    measures_of(vectors, form.measures);
    const closest_point closest = closest_tapered_point(&form, taper);
    parameters[0] = closest.u;
    parameters[1] = closest.v;
    return sqrt(squared_length_between(vectors, closest.u, closest.v)) - taper * closest.v;
}

/* The closest point of the rounded distance at some measures, which become the rounded ones. */
static closest_point closest_in_frame(const pair_frame *frame, double measures[6])
{
    distance_form form = {.vectors = NULL, .corner = {frame->corner[0], frame->corner[1]},
                          .is_square = 1};
    add_rounding(frame, measures);
    memcpy(form.measures, measures, sizeof form.measures);
    return closest_tapered_point(&form, frame->shape);
}

static double distance_of_cone(const pair_frame *frame, const pair_vectors *vectors,
                               double gradient[6])
{
    double measures[6];
    measures_of(vectors, measures);
    const closest_point closest = closest_in_frame(frame, measures);
    const double length = fmax(sqrt(rounded_square(frame, vectors, closest.u, closest.v)),
                               SHORTEST_LENGTH);
    distance_weights(closest.u, closest.v, gradient);
    for (int m = 0; m < 6; ++m) gradient[m] /= 2 * length;
    return length - frame->shape * (closest.v - frame->corner[1]);
}

/* Of f(u, v; e) = sqrt(phi.e) - taper v along a direction (du, dv) in which (u, v) is free:
   hessian -= weight h h^T/f_dd, with h the derivative of df/de. */
static void add_tapered_direction(const closest_point *closest, double du, double dv, double length,
                                  const double e[6], double weight, double hessian[6][6])
{
    const double u = closest->u, v = closest->v, cube = 4 * length * length * length;
    const double by_u[6] = {0, 2, 0, 2 * u, 2 * v, 0}, by_v[6] = {0, 0, 2, 0, 2 * u, 2 * v};
    double phi[6], along[6], h[6], slope = 0;
    distance_weights(u, v, phi);
    for (int m = 0; m < 6; ++m) {
        along[m] = du * by_u[m] + dv * by_v[m];
        slope += along[m] * e[m];
    }
    for (int m = 0; m < 6; ++m) h[m] = along[m] / (2 * length) - phi[m] * slope / cube;
    const double curvature = (du * du * e[3] + 2 * du * dv * e[4] + dv * dv * e[5]) / length -
        slope * slope / cube;
    if (!(curvature > 0)) return;
    for (int m = 0; m < 6; ++m)
        for (int k = 0; k < 6; ++k) hessian[m][k] -= weight * h[m] * h[k] / curvature;
}

static void derivatives_of_cone(const pair_frame *frame, const double measures[6],
                                double gradient[6],
                                double (*hessian)[6], double weight)
{
    double e[6], phi[6];
    memcpy(e, measures, sizeof e);
    const closest_point closest = closest_in_frame(frame, e);
    distance_weights(closest.u, closest.v, phi);
    double square = 0;
    for (int m = 0; m < 6; ++m) square += phi[m] * e[m];
    const double length = fmax(sqrt(fmax(square, 0)), SHORTEST_LENGTH);
    for (int m = 0; m < 6; ++m) gradient[m] = phi[m] / (2 * length);
    if (!hessian) return;
    const double cube = 4 * length * length * length;
    for (int m = 0; m < 6; ++m)
        for (int k = 0; k < 6; ++k) hessian[m][k] -= weight * phi[m] * phi[k] / cube;
    if (closest.curvature > 0)
        add_tapered_direction(&closest, closest.direction[0], closest.direction[1], length, e,
                              weight, hessian);
    if (closest.last_curvature > 0)
        add_tapered_direction(&closest, -closest.shear, 1, length, e, weight, hessian);
}

/* Inside a cone s = height sin(alpha) - distance from the axis cos(alpha), (2) of cone.py.  With
   directions of the length cos(alpha) it is sqrt(Q) - sqrt(p), where p = (r.a)^2 + (r.b)^2 and
   Q = (1 - a.a) r.r - p/a.a + p. */
static double inside_cone(double shape, const double measures[6], double gradient[6],
                          double (*hessian)[6], double weight)
{
    (void)shape;
    const double *e = measures, square = e[3];
    const double p = e[1] * e[1] + e[2] * e[2], Q = (1 - square) * e[0] - p / square + p;
    const double across = fmax(sqrt(p), SHORTEST_LENGTH), height = sqrt(fmax(Q, SHORTEST_LENGTH));
    const double factor = 2 * (1 - 1 / square), ratio = 2 / (square * square);
    const double of_square = p / (square * square) - e[0];
    const double of_Q[6] = {1 - square, factor * e[1], factor * e[2], of_square, 0, 0};
    const double of_across[6] = {0, e[1] / across, e[2] / across, 0, 0, 0};
    for (int m = 0; m < 6; ++m) gradient[m] = of_Q[m] / (2 * height) - of_across[m];
    if (!hessian) return height - sqrt(p);
    const double second[4][4] = {{0, 0, 0, -1},
                                 {0, factor, 0, ratio * e[1]},
                                 {0, 0, factor, ratio * e[2]},
                                 {-1, ratio * e[1], ratio * e[2], -ratio * p / square}};
    for (int m = 0; m < 4; ++m)
        for (int k = 0; k < 4; ++k) {
            const double bend = second[m][k] / (2 * height) -
                of_Q[m] * of_Q[k] / (4 * height * height * height);
            const double of_axis = (m == k && (m == 1 || m == 2)) - of_across[m] * of_across[k];
            hessian[m][k] += weight * (bend - of_axis / across);
        }
    return height - sqrt(p);
}

/* ---- all kinds; the row is the number of the kind ---- */

enum { KIND_COUNT = 7 };

/* Kinds are bytes; those of laws are set when they are compiled. */
stencil STENCILS[256] = {
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
     .boundary = plane,
     .is_linear = 1,
     .length_of = length_of_distance},
    {.name = "POINT_IN_SPHERE",
     .coefficients = {{1, -1, 0, 0}, {0, 0, 0, 0}, {0, 0, 0, 0}},
     .first_count = 1,
     .boundary = inside_sphere,
     .is_linear = 1,
     .length_of = length_in_room},
    {.name = "POINT_IN_CYLINDER",
     .coefficients = {{1, -1, 0, 0}, {0, 0, 1, 0}, {0, 0, 0, 1}},
     .first_count = 1,
     .boundary = inside_cylinder,
     .is_linear = 1,
     .length_of = length_in_room},
    {.name = "EDGE_CONE",
     .coefficients = {{1, 0, -1, 0}, {-1, 1, 0, 0}, {0, 0, 1, -1}},
     .first_count = 2,
     .is_rounded = 1,
     .is_linear = 1,
     .closest = closest_of_cone,
     .distance = distance_of_cone,
     .derivatives = derivatives_of_cone,
     .length_of = length_of_distance},
    {.name = "POINT_IN_CONE",
     .coefficients = {{1, -1, 0, 0}, {0, 0, 1, 0}, {0, 0, 0, 1}},
     .first_count = 1,
     .boundary = inside_cone,
     .is_linear = 1,
     .length_of = length_of_distance},
};

int kind_count(void) { return KIND_COUNT; }

const char *kind_name(int kind) { return STENCILS[kind].name; }

void set_boundary_law(int kind, uintptr_t law)
{
    STENCILS[kind] = (stencil){.name = "LAW",
                               .coefficients = {{1, -1, 0, 0}, {0, 0, 1, 0}, {0, 0, 0, 1}},
                               .first_count = 1,
                               .law = (void (*)(const double *, double *, double *, double *))law,
                               .is_linear = 1,
                               .length_of = length_of_distance};
}
