/* Additive continuous collision detection: whether pairs keep a least gap on straight lines.

   Li, Kaufman, Jiang: "Codimensional incremental potential contact", ACM Trans. Graph. 40 (2021)
   170, section 4, doi:10.1145/3450626.3459767: a pair may advance by the part of its gap that its
   points can cover at most, again and again. */
#include "closest_point.h"

/* Part of the way that is certainly free by which a pair advances: the rest keeps it clear of
   round-off. */
static const double ADVANCE = 0.9;

/* A gap below this multiple of the least one ends the motion: the advances would become shorter and
   shorter. */
static const double STOP = 1.01;

static double squared_distance_at(int kind, const int32_t *points, const pair_motion *motion,
                                  double t)
{
    static const int32_t own_points[4] = {0, 1, 2, 3};
    double x[12];
    for (int k = 0; k < 4; ++k) {
        const double *x0 = point(motion->x0, points[k]), *x1 = point(motion->x1, points[k]);
        for (int c = 0; c < 3; ++c) x[3 * k + c] = x0[c] + t * (x1[c] - x0[c]);
    }
    const pair_vectors vectors = vectors_at(PAIR_COEFFICIENTS[kind], x, own_points);
    const closest_point closest = closest_point_of_vectors(kind, &vectors);
    return squared_length_between(&vectors, closest.u, closest.v);
}

static int keeps_least_gap(int kind, const int32_t *points, const pair_motion *motion, ptrdiff_t i)
{
    const double least = motion->min_gap[i];
    const double way = approach_bound(kind, motion->x0, motion->x1, points);
    double t = 0, gap = motion->gap[i];
    if (way <= gap - least) return 1;
    for (int step = 0; step < motion->max_advances; ++step) {
        const double advance = ADVANCE * (gap - least) / way;
        if (t + advance >= 1) return 1;
        t += advance;
        gap = sqrt(squared_distance_at(kind, points, motion, t)) - motion->radius[i];
        if (!(gap > STOP * least)) return 0;
    }
    return 0; /* not decided after so many advances: the caller takes a shorter step */
}

ptrdiff_t check_motion(const pair_list *pairs, const pair_motion *motion, uint8_t *keeps_gap)
{
    ptrdiff_t count = 0;
    for (ptrdiff_t i = 0; i < pairs->count; ++i) {
        keeps_gap[i] = (uint8_t)keeps_least_gap(pairs->kind[i], pairs->points + 4 * i, motion, i);
        count += !keeps_gap[i];
    }
    return count;
}
