/* A pair as three vectors r, a, b, linear in its four points: r from the second side to the first,
   a and b along the sides.  Its squared distance is the least |r + u a + v b|^2 over (u, v) in a
   triangle or a square, and depends on the points only through the six measures e = (r.r, r.a, r.b,
   a.a, a.b, b.b). */
#ifndef GOSSAMER_PAIR_GEOMETRY_H
#define GOSSAMER_PAIR_GEOMETRY_H

#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include "contact.h"
#include "vectors.h"

/* Which two vectors make each measure. */
static const int MEASURE_FIRST[6] = {0, 0, 0, 1, 1, 2};
static const int MEASURE_SECOND[6] = {0, 1, 2, 1, 2, 2};

typedef struct {
    double row[3][3]; /* r, a, b */
} pair_vectors;

/* The vectors r, a, b of four points, given by their rows in x. */
static inline pair_vectors vectors_at(const double coefficients[3][4], const double *x,
                                      const int32_t *points)
{
    pair_vectors vectors;
    for (int i = 0; i < 3; ++i)
        for (int c = 0; c < 3; ++c) {
            double sum = 0;
            for (int k = 0; k < 4; ++k)
                if (coefficients[i][k] != 0) sum += coefficients[i][k] * point(x, points[k])[c];
            vectors.row[i][c] = sum;
        }
    return vectors;
}

static inline void measures_of(const pair_vectors *vectors, double measures[6])
{
    for (int m = 0; m < 6; ++m) measures[m] = dot(vectors->row[MEASURE_FIRST[m]],
                                                  vectors->row[MEASURE_SECOND[m]]);
}

/* r + u a + v b */
static inline void vector_between(const pair_vectors *vectors, double u, double v,
                                  double between[3])
{
    for (int c = 0; c < 3; ++c) between[c] = vectors->row[0][c] + u * vectors->row[1][c] + v * vectors->row[2][c];
}

static inline double squared_length_between(const pair_vectors *vectors, double u, double v)
{
    double between[3];
    vector_between(vectors, u, v, between);
    return dot(between, between);
}

/* Whether parameters (u, v) that count from the domain's corner are in it. */
static inline int is_in_domain(int is_square, double u, double v)
{
    return u >= 0 && v >= 0 && (is_square ? u <= 1 && v <= 1 : u + v <= 1);
}

/* Upper bound of how much closer the two sides can be at x1, or on the way there, than at x0.  The
   mean displacement of the four points changes no distance.  The first side has one point or two. */
static inline double approach_bound(int first_count, const double *x0, const double *x1,
                                    const int32_t *points)
{
    double displacement[4][3], mean[3] = {0}, length[4];
    for (int k = 0; k < 4; ++k)
        for (int c = 0; c < 3; ++c) {
            displacement[k][c] = point(x1, points[k])[c] - point(x0, points[k])[c];
            mean[c] += displacement[k][c] / 4;
        }
    for (int k = 0; k < 4; ++k) {
        for (int c = 0; c < 3; ++c) displacement[k][c] -= mean[c];
        length[k] = sqrt(dot(displacement[k], displacement[k]));
    }
    if (first_count == 2) return fmax(length[0], length[1]) + fmax(length[2], length[3]);
    return length[0] + fmax(length[1], fmax(length[2], length[3]));
}

/* How much closer the two sides can be for points that miss their expected positions by up to
   margin (m). */
static inline double margin_of_pair(int first_count, const double *margin, const int32_t *points)
{
    const double first = margin[points[0]], second = margin[points[1]];
    const double others = fmax(margin[points[2]], margin[points[3]]);
    return first_count == 2 ? fmax(first, second) + others : first + fmax(second, others);
}

#endif
