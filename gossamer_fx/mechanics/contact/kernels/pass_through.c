/* Iterates that have passed through something: see pass_through.h. */
#include "pass_through.h"

/* Of the search for the moment at which r, a and b lie in one plane: the interval is then 1/4096 of
   the step. */
static const int BISECTIONS = 12;

/* Squared distance at that moment, over the squared motion of the vectors, up to which the sides
   count as touching. Vectors that lie in one plane all the way have a volume of round-off, whose
   sign says nothing. */
static const double MEETING_DISTANCE = 1e-5;

/* Shorter vectors have no direction. */
static const double SHORTEST_NORMAL = 1e-12;

/* The volume r.(a x b); its sign changes where the two sides of the pair, endlessly extended, meet. */
static double volume_of(const pair_vectors *vectors)
{
    double normal[3];
    cross(vectors->row[1], vectors->row[2], normal);
    return dot(vectors->row[0], normal);
}

/* The vectors after the part t of a straight motion. */
static pair_vectors vectors_between(const pair_vectors *start, const pair_vectors *end, double t)
{
    pair_vectors vectors;
    for (int i = 0; i < 3; ++i)
        for (int c = 0; c < 3; ++c)
            vectors.row[i][c] = start->row[i][c] + t * (end->row[i][c] - start->row[i][c]);
    return vectors;
}

/* The vectors at the moment when their volume changes its sign. */
static pair_vectors vectors_in_one_plane(const pair_vectors *start, const pair_vectors *end,
                                         double start_volume)
{
    double before = 0, after = 1;
    pair_vectors vectors = *start;
    for (int k = 0; k < BISECTIONS; ++k) {
        const double t = (before + after) / 2;
        vectors = vectors_between(start, end, t);
        if (volume_of(&vectors) * start_volume > 0) before = t;
        else after = t;
    }
    return vectors;
}

int has_passed_through(const pair_frame *frame, const pair_vectors *start, const pair_vectors *end)
{
    const double start_volume = volume_of(start);
    if (!(start_volume * volume_of(end) < 0)) return 0;
    const pair_vectors flat = vectors_in_one_plane(start, end, start_volume);
    double e[6];
    measures_of(&flat, e);
    const double det = e[3] * e[5] - e[4] * e[4];
    if (!(det > 0)) return 0;
    const double u = (e[4] * e[2] - e[5] * e[1]) / det, v = (e[4] * e[1] - e[3] * e[2]) / det;
    if (!is_in_domain(frame->of->first_count == 2, u - frame->corner[0], v - frame->corner[1])) return 0;
    double squared_distance = 0, squared_motion = 0;
    for (int c = 0; c < 3; ++c) {
        const double between = flat.row[0][c] + u * flat.row[1][c] + v * flat.row[2][c];
        squared_distance += between * between;
        for (int i = 0; i < 3; ++i) {
            const double change = end->row[i][c] - start->row[i][c];
            squared_motion += change * change;
        }
    }
    return squared_distance <= MEETING_DISTANCE * squared_motion;
}

/* Unit vector along which the distance at the end grows, its weights at the four points, and the
   signed distance. */
typedef struct {
    double normal[3], weight[4], distance;
} contact_direction;

/* The direction in which the point moves fastest away from a boundary; in a room that is towards the
   middle, from which distances count. */
static contact_direction direction_of_boundary(const pair_frame *frame, const pair_vectors *end)
{
    contact_direction found;
    double by_measures[6];
    const double s = pair_distance(frame, end, by_measures);
    found.distance = frame->of->length_of(s);
    memcpy(found.weight, frame->coefficients[0], sizeof found.weight);
    for (int c = 0; c < 3; ++c)
        found.normal[c] = 2 * by_measures[0] * end->row[0][c] + by_measures[1] * end->row[1][c] +
                          by_measures[2] * end->row[2][c];
    const double length = sqrt(dot(found.normal, found.normal));
    for (int c = 0; c < 3; ++c) found.normal[c] /= length;
    return found;
}

/* Of surfaces it is that of the vector between the closest points, where ds/de is a multiple of
   phi(u, v). */
static contact_direction direction_of_surfaces(const pair_frame *frame, const pair_vectors *end,
                                               int has_passed)
{
    contact_direction found;
    double by_measures[6];
    pair_frame plain = *frame;
    plain.rounding = 0;
    const double s = pair_distance(&plain, end, by_measures);
    const double u = by_measures[1] / (2 * by_measures[0]), v = by_measures[2] / (2 * by_measures[0]);
    const double sign = has_passed ? -1 : 1;
    vector_between(end, u, v, found.normal);
    const double length = sqrt(dot(found.normal, found.normal));
    for (int c = 0; c < 3; ++c)
        found.normal[c] = length > SHORTEST_NORMAL ? sign * found.normal[c] / length : 0;
    for (int k = 0; k < 4; ++k)
        found.weight[k] = frame->coefficients[0][k] + u * frame->coefficients[1][k] +
                          v * frame->coefficients[2][k];
    found.distance = frame->of->length_of(s) - (has_passed ? 2 * length : 0);
    return found;
}

void push_back(const pair_frame *frame, const pair_vectors *end, const signed_distances *distances,
               double stiffness, const pair_output *output)
{
    const contact_direction along =
        is_boundary(frame->of) ? direction_of_boundary(frame, end)
                               : direction_of_surfaces(frame, end, distances->has_passed);
    const double start = distances->at_start, activation = distances->activation, final = along.distance;
    /* the mean force of the parabola over the part of the way from start to end on which there is
       contact */
    const double way = start - final, depth = activation - final;
    const int starts_in_contact = start < activation;
    const double mean = starts_in_contact ? activation - (start + final) / 2 : depth * depth / (2 * way);
    const double derivative = starts_in_contact ? 0.5 : depth / way - depth * depth / (2 * way * way);
    const double *weight = along.weight, *normal = along.normal;
    for (int k = 0; k < 4; ++k)
        for (int i = 0; i < 3; ++i) {
            output->force[3 * k + i] = -stiffness * mean * weight[k] * normal[i];
            if (!output->tangent) continue;
            for (int l = 0; l < 4; ++l)
                for (int j = 0; j < 3; ++j)
                    output->tangent[12 * (3 * k + i) + 3 * l + j] =
                        stiffness * derivative * weight[k] * normal[i] * weight[l] * normal[j];
        }
}
