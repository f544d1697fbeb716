/* Parting of pairs that pass through each other in an iterate: see contact.h. */
#include "pass_through.h"

/* Weights of the four points in the vector between the two points that meet. */
static void weights_of_points(const pair_frame *frame, const pair_meeting *meeting, double weight[4])
{
    for (int k = 0; k < 4; ++k)
        weight[k] = frame->coefficients[0][k] + meeting->u * frame->coefficients[1][k] +
                    meeting->v * frame->coefficients[2][k];
}

/* Put one pair at its distance on the side where it began, if it has passed; returns whether it was moved. */
static int separate(const pair_list *pairs, const pair_separation *separation, ptrdiff_t i)
{
    const int32_t *points = pairs->points + 4 * i;
    const pair_frame frame = frame_of_kind(pairs->kind[i], 0);
    const pair_vectors start = vectors_at(frame.coefficients, separation->x0, points);
    const pair_vectors end = vectors_at(frame.coefficients, separation->x1, points);
    pair_meeting meeting;
    if (!find_meeting(&frame, &start, &end, &meeting)) return 0;
    double weight[4], distance = 0, mobility = 0;
    weights_of_points(&frame, &meeting, weight);
    for (int k = 0; k < 4; ++k) {
        distance += weight[k] * dot(meeting.normal, point(separation->x1, points[k]));
        mobility += weight[k] * weight[k] * separation->mobility[points[k]];
    }
    const double missing = separation->distance[i] - distance;
    if (!(missing > 0 && mobility > 0)) return 0;
    /* Weights sum up to zero, and so do the impulses: the momentum of the iterate stays. */
    const double impulse = missing / mobility;
    for (int k = 0; k < 4; ++k) {
        double *x = separation->x1 + 3 * (ptrdiff_t)points[k];
        const double length = impulse * weight[k] * separation->mobility[points[k]];
        for (int c = 0; c < 3; ++c) x[c] += length * meeting.normal[c];
    }
    return 1;
}

ptrdiff_t separate_pairs(const pair_list *pairs, const pair_separation *separation)
{
    ptrdiff_t total = 0;
    for (int sweep = 0; sweep < separation->max_sweeps; ++sweep) {
        ptrdiff_t moved = 0;
        for (ptrdiff_t i = 0; i < pairs->count; ++i)
            if (!is_wall(pairs->kind[i])) moved += separate(pairs, separation, i);
        if (!moved) break;
        total += moved;
    }
    return total;
}
