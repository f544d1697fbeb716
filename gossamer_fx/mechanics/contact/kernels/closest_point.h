/* The closest points of a triangle pair or an edge pair: the minimum of the quadratic form

       q(u, v) = r.r + 2 u r.a + 2 v r.b + u^2 a.a + 2 u v a.b + v^2 b.b

   over a triangle or a square: in its interior, or else on one of its sides.  The form is given by
   the vectors, which keep the digits of thin triangles and of edges that are almost parallel, or by
   the six measures alone, where there are no vectors: on the path of measures between two states.
   */
#ifndef GOSSAMER_CLOSEST_POINT_H
#define GOSSAMER_CLOSEST_POINT_H

#include "pair_geometry.h"

/* Without it the compiler keeps one copy for both forms, which asks at run time what is known where
   it is called: a tenth of the time of tangents. */
#define INLINED static inline __attribute__((always_inline))

/* det/(a.a b.b), the squared sine of the angle between a and b: above the first the interior
   minimum is the solution; down to the second, vectors still tell where it is, and the sides are
   tried as well. */
static const double SAFE_SINE_SQUARED = 1e-14;
static const double SMALLEST_SINE_SQUARED = 1e-24;

typedef struct {
    const pair_vectors *vectors; /* NULL: the measures alone are known */
    double measures[6];
    double corner[2]; /* of the domain */
    int is_square;    /* whether the domain is the square of two edges; else it is the triangle */
} distance_form;

typedef struct {
    double u, v;
    /* along which (u, v) is free; in the interior the first of two directions */
    double direction[2];
    double curvature;      /* of q along it; 0: a corner, (u, v) is not free */
    double shear;          /* interior: the second direction is (-shear, 1) */
    double last_curvature; /* of q along the second direction; 0: not in the interior */
} closest_point;

typedef struct {
    double u, v, du, dv; /* start and direction, from the domain's corner */
} domain_side;

static const domain_side TRIANGLE_SIDES[3] = {{0, 0, 0, 1}, {0, 0, 1, 0}, {0, 1, 1, -1}};
static const domain_side SQUARE_SIDES[4] = {{0, 0, 0, 1}, {0, 0, 1, 0}, {1, 0, 0, 1}, {0, 1, 1, 0}};

/* The minimum of q along a side: where it is, from 0 to 1; q there, but for a constant; and the
   second derivative. */
typedef struct {
    double t, value, curvature;
} side_minimum;

static inline double clip_to_unit(double t)
{
    if (!(t > 0)) return 0;
    return t < 1 ? t : 1;
}

/* Solve grad q = 0.  Returns det = a.a b.b - (a.b)^2, or 0 if a and b are parallel as far as the
   form can tell. */
INLINED double interior_minimum(const distance_form *form, double *u, double *v)
{
    const double *e = form->measures;
    if (!form->vectors) {
        const double det = e[3] * e[5] - e[4] * e[4];
        if (!(det > SAFE_SINE_SQUARED * e[3] * e[5])) return 0;
        *u = (e[4] * e[2] - e[5] * e[1]) / det;
        *v = (e[4] * e[1] - e[3] * e[2]) / det;
        return det;
    }
    const double(*row)[3] = form->vectors->row;
    double normal[3], moment[3];
    cross(row[1], row[2], normal);
    const double det = dot(normal, normal);
    if (!(det > SMALLEST_SINE_SQUARED * e[3] * e[5])) return 0;
    cross(row[0], row[2], moment);
    *u = -dot(moment, normal) / det;
    cross(row[1], row[0], moment);
    *v = -dot(moment, normal) / det;
    return det;
}

/* The minimum along a side, from the measures alone. */
INLINED side_minimum minimum_of_measures(const distance_form *form, const domain_side *side)
{
    const double *e = form->measures;
    const double du = side->du, dv = side->dv;
    double u = form->corner[0] + side->u, v = form->corner[1] + side->v;
    const double curvature = du * du * e[3] + 2 * du * dv * e[4] + dv * dv * e[5];
    const double slope = du * (e[1] + u * e[3] + v * e[4]) + dv * (e[2] + u * e[4] + v * e[5]);
    const double t = curvature > 0 ? clip_to_unit(-slope / curvature) : 0;
    u += t * du;
    v += t * dv;
    const double value = u * (2 * e[1] + u * e[3] + 2 * v * e[4]) + v * (2 * e[2] + v * e[5]);
    return (side_minimum){t, value, curvature};
}

/* The minimum along a side, from vectors whose r starts at the domain's corner. */
INLINED side_minimum minimum_of_vectors(const distance_form *form, const domain_side *side)
{
    const double(*row)[3] = form->vectors->row;
    double between[3], direction[3];
    for (int c = 0; c < 3; ++c) {
        between[c] = row[0][c] + side->u * row[1][c] + side->v * row[2][c];
        direction[c] = side->du * row[1][c] + side->dv * row[2][c];
    }
    const double curvature = dot(direction, direction);
    const double t = curvature > 0 ? clip_to_unit(-dot(between, direction) / curvature) : 0;
    for (int c = 0; c < 3; ++c) between[c] += t * direction[c];
    return (side_minimum){t, dot(between, between), curvature};
}

/* Set `found` to the closest point of the sides, if it is closer than `best`. */
INLINED void closest_on_sides(const distance_form *form, const domain_side *sides, int count,
                              double best, closest_point *found)
{
    for (int i = 0; i < count; ++i) {
        const domain_side *side = sides + i;
        const side_minimum minimum = form->vectors ? minimum_of_vectors(form, side) : minimum_of_measures(form, side);
        if (!(minimum.value < best)) continue;
        best = minimum.value;
        found->u = form->corner[0] + side->u + minimum.t * side->du;
        found->v = form->corner[1] + side->v + minimum.t * side->dv;
        found->direction[0] = side->du;
        found->direction[1] = side->dv;
        found->curvature = minimum.t > 0 && minimum.t < 1 ? 2 * minimum.curvature : 0;
    }
}

/* The minimum of q over the domain. */
INLINED closest_point closest_point_of(const distance_form *form)
{
    const double *e = form->measures;
    closest_point found = {0};
    double u = 0, v = 0, best = INFINITY;
    const double det = interior_minimum(form, &u, &v);
    if (det > 0 && is_in_domain(form->is_square, u - form->corner[0], v - form->corner[1])) {
        found.u = u;
        found.v = v;
        if (!form->vectors || det > SAFE_SINE_SQUARED * e[3] * e[5]) {
            found.direction[0] = 1;
            found.curvature = 2 * e[3];
            found.shear = e[4] / e[3];
            found.last_curvature = 2 * det / e[3];
            return found;
        }
        /* a and b are almost parallel: the sides may be closer than what round-off left of the
           interior minimum */
        best = squared_length_between(form->vectors, u, v);
    }
    if (form->is_square) closest_on_sides(form, SQUARE_SIDES, 4, best, &found);
    else closest_on_sides(form, TRIANGLE_SIDES, 3, best, &found);
    return found;
}

/* Of vectors whose r starts at the domain's corner. */
INLINED closest_point closest_point_of_vectors(int is_square, const pair_vectors *vectors)
{
    distance_form form = {.vectors = vectors, .corner = {0, 0}, .is_square = is_square};
    measures_of(vectors, form.measures);
    return closest_point_of(&form);
}

INLINED closest_point closest_point_of_measures(int is_square, const double measures[6],
                                                const double corner[2])
{
    distance_form form = {.vectors = NULL, .corner = {corner[0], corner[1]}, .is_square = is_square};
    memcpy(form.measures, measures, sizeof form.measures);
    return closest_point_of(&form);
}

#endif
