/* A stencil: all that is different from one kind of contact pair to the next.

   A pair is four points, from which it has three vectors r, a, b.  Its stencil says what the
   distance function s of these vectors is, with its derivatives by the six measures e.  Everything
   else (broad phase, continuous collision, energy, forces, tangents) asks the stencil.  A new kind
   is a row of STENCILS in stencils.c, and the class of the same name and number in Python; that of a
   boundary may also be a law (core/laws), see LawBoundary in pairs.py. */
#ifndef GOSSAMER_STENCIL_H
#define GOSSAMER_STENCIL_H

#include "pair_geometry.h"

typedef struct stencil stencil;

/* Geometry of one pair whose vector r may start at any point of the second side. */
typedef struct {
    const stencil *of;
    double coefficients[3][4]; /* of the points in r, a, b */
    double corner[2];          /* of the domain of (u, v), which counts from the start of r */
    double rounding;           /* epsilon [m^2] of two edges, else 0 */
    double shape;              /* number of the pair that its stencil needs */
} pair_frame;

struct stencil {
    const char *name;
    double coefficients[3][4]; /* r, a, b as combinations of the four points */
    int first_count; /* points of the first side; with two the domain of (u, v) is a square */
    int is_rounded; /* whether the distance is rounded, as that of edges, which may be parallel */
    int is_linear;  /* whether energies are those of a ratio of distances, not of their squares */
    double (*length_of)(double s); /* the distance [m] that belongs to s; negative in rooms */

    /* A boundary: a point cannot get behind it, so that it has no (u, v) and needs no continuous
       collision detection.  s at some measures, and the entries of ds/de that are not zero; if
       `hessian` is not NULL, weight times d2s/de2 is added to it. */
    double (*boundary)(double shape, const double measures[6], double gradient[6],
                   double (*hessian)[6], double weight);
    /* Instead: a law of the measures and the number of the pair, which sets its value, and if they
       are not NULL its derivatives by the measures, (6) and (6, 6). */
    void (*law)(const double *x, double *s, double *gradient, double *hessian);

    /* Two surfaces: s of the vectors and the parameters (u, v) of the closest points, not rounded;
       s of the vectors in a frame and ds/de; and the derivatives at some measures. */
    double (*closest)(const pair_vectors *vectors, double shape, double parameters[2]);
    double (*distance)(const pair_frame *frame, const pair_vectors *vectors, double gradient[6]);
    void (*derivatives)(const pair_frame *frame, const double measures[6], double gradient[6],
                        double (*hessian)[6], double weight);
};

extern stencil STENCILS[];

static inline double shape_of(const pair_list *pairs, ptrdiff_t i)
{
    return pairs->shape ? pairs->shape[i] : 0;
}

static inline int is_boundary(const stencil *of) { return of->boundary || of->law; }

/* s of a boundary, see `boundary` of a stencil. */
static inline double boundary_distance(const stencil *of, double shape, const double measures[6],
                                       double gradient[6], double (*hessian)[6], double weight)
{
    if (!of->law) return of->boundary(shape, measures, gradient, hessian, weight);
    double x[7], s, second[36];
    memcpy(x, measures, 6 * sizeof *x);
    x[6] = shape;
    of->law(x, &s, gradient, hessian ? second : NULL);
    if (hessian)
        for (int m = 0; m < 6; ++m)
            for (int k = 0; k < 6; ++k) hessian[m][k] += weight * second[6 * m + k];
    return s;
}

/* ds/de at some measures; if `hessian` is not NULL, weight times d2s/de2 is added to it. */
static inline void distance_derivatives(const pair_frame *frame, const double measures[6],
                                        double gradient[6], double (*hessian)[6], double weight)
{
    memset(gradient, 0, 6 * sizeof *gradient);
    if (is_boundary(frame->of))
        boundary_distance(frame->of, frame->shape, measures, gradient, hessian, weight);
    else frame->of->derivatives(frame, measures, gradient, hessian, weight);
}

/* s at some vectors, and its gradient ds/de. */
static inline double pair_distance(const pair_frame *frame, const pair_vectors *vectors,
                                   double gradient[6])
{
    if (!is_boundary(frame->of)) return frame->of->distance(frame, vectors, gradient);
    double measures[6];
    memset(gradient, 0, 6 * sizeof *gradient);
    measures_of(vectors, measures);
    return boundary_distance(frame->of, frame->shape, measures, gradient, NULL, 0);
}

/* s at some vectors, not rounded, and the parameters of the closest points; zero for boundaries. */
static inline double closest_distance(const stencil *of, double shape, const pair_vectors *vectors,
                                      double parameters[2])
{
    if (!is_boundary(of)) return of->closest(vectors, shape, parameters);
    double measures[6], gradient[6];
    parameters[0] = parameters[1] = 0;
    measures_of(vectors, measures);
    return boundary_distance(of, shape, measures, gradient, NULL, 0);
}

/* The frame of a pair before `move_base`; rounding is a part of the width [m^2], or of its square if
   the width is a distance [m]. */
static inline pair_frame frame_of(const stencil *of, double shape, double rounding, double width)
{
    pair_frame frame = {.of = of, .corner = {0, 0}, .rounding = 0, .shape = shape};
    if (of->is_rounded) frame.rounding = rounding * (of->is_linear ? width * width : width);
    memcpy(frame.coefficients, of->coefficients, sizeof frame.coefficients);
    return frame;
}

/* Let r lead to the point with parameters (u, v), in the frame and in the vectors.  At the closest
   points r is short, so that small distances of large triangles keep their digits. */
static inline void move_base(pair_frame *frame, double u, double v, pair_vectors *vectors)
{
    for (int k = 0; k < 4; ++k)
        frame->coefficients[0][k] += u * frame->coefficients[1][k] + v * frame->coefficients[2][k];
    for (int c = 0; c < 3; ++c) vectors->row[0][c] += u * vectors->row[1][c] + v * vectors->row[2][c];
    frame->corner[0] = -u;
    frame->corner[1] = -v;
}

#endif
