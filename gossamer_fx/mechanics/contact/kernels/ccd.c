/* Additive continuous collision detection: whether pairs keep a least gap on straight lines.

   Li, Kaufman, Jiang: "Codimensional incremental potential contact", ACM Trans. Graph. 40 (2021)
   170, section 4, doi:10.1145/3450626.3459767: a pair may advance by the part of its gap that its
   points can cover at most, again and again. */
#include "stencil.h"

/* Part of the way that is certainly free by which a pair advances: the rest keeps it clear of
   round-off. */
static const double ADVANCE = 0.9;

/* A gap below this multiple of the least one ends the motion: the advances would become shorter and
   shorter. */
static const double STOP = 1.01;

/* The distance [m] of the two sides after the part t of the motion. */
static double distance_at(const stencil *of, double shape, const int32_t *points,
                          const pair_motion *motion, double t)
{
    static const int32_t own_points[4] = {0, 1, 2, 3};
    double x[12], parameters[2];
    for (int k = 0; k < 4; ++k) {
        const double *x0 = point(motion->x0, points[k]), *x1 = point(motion->x1, points[k]);
        for (int c = 0; c < 3; ++c) x[3 * k + c] = x0[c] + t * (x1[c] - x0[c]);
    }
    const pair_vectors vectors = vectors_at(of->coefficients, x, own_points);
    return of->length_of(of->closest(&vectors, shape, parameters));
}

/* Whether pair i keeps its least gap; 0 also if that could not be decided. */
static int keeps_least_gap(const pair_list *pairs, const pair_motion *motion, ptrdiff_t i)
{
    const stencil *of = STENCILS + pairs->kind[i];
    const int32_t *points = pairs->points + 4 * i;
    const double least = motion->min_gap[i];
    const double way = approach_bound(of->first_count, motion->x0, motion->x1, points);
    double t = 0, gap = motion->gap[i];
    if (way <= gap - least) return 1;
    for (int step = 0; step < motion->max_advances; ++step) {
        const double advance = ADVANCE * (gap - least) / way;
        if (t + advance >= 1) return 1;
        t += advance;
        gap = distance_at(of, shape_of(pairs, i), points, motion, t) - motion->radius[i];
        if (!(gap > STOP * least)) return 0;
    }
    return 0; /* not decided after so many advances: the caller takes a shorter step */
}

ptrdiff_t check_motion(const pair_list *pairs, const pair_motion *motion, uint8_t *keeps_gap)
{
    ptrdiff_t count = 0;
    for (ptrdiff_t i = 0; i < pairs->count; ++i) {
        keeps_gap[i] = (uint8_t)keeps_least_gap(pairs, motion, i);
        count += !keeps_gap[i];
    }
    return count;
}
