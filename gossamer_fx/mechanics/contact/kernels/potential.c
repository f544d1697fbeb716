/* Energy, forces and tangents of contact pairs; contact_step.py has the equations, whose numbers stand
   here in brackets.

   Every pair goes through the same stages: out of range? geometry of the step, case (none,
   touching, passed through), stress and its derivative, force and tangent of the four points, and
   the sum over pairs. */
#include "contact_law.h"
#include "pass_through.h"
#include "stencil.h"

/* Part of its scaled distance x that a pair of edges with a barrier must keep in a step.  Rounded
   edges can come below the offset of their barrier, where it has no energy: from here on it goes on
   as a parabola of x. */
static const double LEAST_KEPT_DISTANCE = 0.02;

/* Error of (2) over the squared distances below which it is their round-off, which is not corrected:
   in a pair at rest the correction would divide it by a change of the same size. */
static const double ROUND_OFF = 1e-15;

/* Gauss points of the path average (2), in the whole path or in each of its equal parts. */
static const double GAUSS_POINTS[2] = {0.21132486540518713, 0.7886751345948129};

/* Parts of the path of two edges.  The closest points of almost parallel ones run from end to end in a
   fifth of the path, by the rounding of s; with two points for the whole path the force jumps there. */
static const int PARTS_OF_EDGES = 4;

/* Which measure is the product of two vectors. */
static const int MEASURE_OF[3][3] = {{0, 1, 2}, {1, 3, 4}, {2, 4, 5}};

/* One pair in one step; in a state alone the start is the same state. */
typedef struct {
    pair_frame frame;
    pair_vectors start, end;
    double stiffness, width, offset;
    double s0, s1;          /* squared distances */
    double x0, x1;          /* scaled distances (s - offset)/width */
    double end_gradient[6]; /* ds/de at the end */
    contact_energy energy;
    int is_state;
} pair_step;

/* Stress S, conjugate to the measures, its derivative with respect to their end, and the vectors in
   which the force De^T S is taken. */
typedef struct {
    double stress[6];
    double derivative[6][6];
    pair_vectors acting;
} pair_stress;

/* ---- the geometry of a step ---- */

/* Whether a pair cannot come into the range of its energy in the step, by its distance at the start;
   not asked of boundaries and states. */
static int is_out_of_range(const active_pairs *pairs, const contact_step *step, ptrdiff_t i)
{
    const stencil *of = STENCILS + pairs->list.kind[i];
    if (is_boundary(of) || step->is_state) return 0;
    const double range = of->length_of(pairs->width[i] + pairs->offset[i]);
    const double start_distance = pairs->start[4 * i + 2];
    return start_distance - range > approach_bound(of->first_count, step->x0, step->x1,
                                                   pairs->list.points + 4 * i);
}

/* Vectors, distances and law of pair i. */
static void set_up(const active_pairs *pairs, const contact_step *step, ptrdiff_t i,
                   pair_step *pair)
{
    const stencil *of = STENCILS + pairs->list.kind[i];
    const int32_t *points = pairs->list.points + 4 * i;
    const double *start = pairs->start + 4 * i;
    pair->stiffness = pairs->stiffness[i];
    pair->width = pairs->width[i];
    pair->offset = pairs->offset[i];
    pair->energy = (contact_energy){pairs->law, of->is_linear};
    pair->is_state = step->is_state;
    pair->frame = frame_of(of, shape_of(&pairs->list, i), pairs->rounding, pair->width);
    pair->start = vectors_at(pair->frame.coefficients, pair->is_state ? step->x1 : step->x0,
                             points);
    if (!is_boundary(of)) move_base(&pair->frame, start[0], start[1], &pair->start);
    pair->end = vectors_at(pair->frame.coefficients, step->x1, points);
    double start_gradient[6];
    pair->s0 =
        is_boundary(of) ? pair_distance(&pair->frame, &pair->start, start_gradient) : start[3];
    pair->s1 = pair_distance(&pair->frame, &pair->end, pair->end_gradient);
    pair->x0 = (pair->s0 - pair->offset) / pair->width;
    pair->x1 = (pair->s1 - pair->offset) / pair->width;
}

/* Whether edges with a barrier come closer in a step than they may. */
static int is_too_steep(const pair_step *pair)
{
    if (pair->energy.law != BARRIER || !pair->frame.of->is_rounded || pair->is_state) return 0;
    return pair->x1 < LEAST_KEPT_DISTANCE * fmin(pair->x0, 1);
}

/* ---- pairs that passed through ---- */

/* Force and tangent of a pair that passed through.  The parabola is as stiff as the penalty of the
   pair over its range, times the ratio. */
static void push_pair_back(const pair_step *pair, int has_passed, double stiffness_ratio,
                           const pair_output *output)
{
    double (*const length_of)(double) = pair->frame.of->length_of;
    const double activation = length_of(pair->offset + pair->width);
    /* the distance over which the pair has energy */
    const double range = activation - length_of(pair->offset);
    const signed_distances distances = {length_of(pair->s0), activation, has_passed};
    push_back(&pair->frame, &pair->end, &distances,
              stiffness_ratio * pair->stiffness / (range * range), output);
}

/* ---- stress ---- */

/* The stress k b'(x) ds/de of a state, and its derivative. */
static void stress_of_state(const pair_step *pair, pair_stress *result)
{
    double measures[6], gradient[6], hessian[6][6] = {{0}};
    measures_of(&pair->end, measures);
    distance_derivatives(&pair->frame, measures, gradient, hessian, 1);
    const double slope = slope_of(pair->energy, pair->x1) / pair->width;
    const double curvature = curvature_of(pair->energy, pair->x1) / (pair->width * pair->width);
    const double *phi = pair->end_gradient;
    for (int m = 0; m < 6; ++m) {
        result->stress[m] = pair->stiffness * slope * phi[m];
        for (int n = 0; n < 6; ++n)
            result->derivative[m][n] = pair->stiffness * (slope * hessian[m][n] + curvature * phi[m] * phi[n]);
    }
    result->acting = pair->end;
}

/* The change of the measures in a step, without the difference of large numbers: D e(middle) (end -
   start). */
static void change_of_measures(const pair_step *pair, const pair_vectors *middle, double change[6])
{
    for (int m = 0; m < 6; ++m) {
        const int i = MEASURE_FIRST[m], j = MEASURE_SECOND[m];
        change[m] = 0;
        for (int c = 0; c < 3; ++c)
            change[m] += middle->row[i][c] * (pair->end.row[j][c] - pair->start.row[j][c]) +
                         (pair->end.row[i][c] - pair->start.row[i][c]) * middle->row[j][c];
    }
}

/* 1 over the squared size of each measure (3): of r.r that is its change over the range of the
   energy, of a.a and b.b their mean in the step.  `length_rates` are the relative changes of these
   lengths by those measures at the end. */
static void weights_of_measures(const pair_step *pair, double weight[6], double length_rates[3])
{
    const stencil *of = pair->frame.of;
    double start[6], end[6], squared_length[3] = {pair->width, 0, 0};
    if (of->is_linear) { /* s may be a distance [m] */
        const double near = of->length_of(pair->offset);
        const double far = of->length_of(pair->offset + pair->width);
        squared_length[0] = fabs(far * far - near * near);
    }
    /* not zero where a side has no length; boundaries have unit vectors for sides, or none */
    const double smallest = is_boundary(of) ? 1 : squared_length[0];
    measures_of(&pair->start, start);
    measures_of(&pair->end, end);
    length_rates[0] = 0;
    for (int i = 1; i < 3; ++i) {
        const int m = MEASURE_OF[i][i];
        squared_length[i] = smallest + (start[m] + end[m]) / 2;
        length_rates[i] = 0.5 / squared_length[i];
    }
    for (int m = 0; m < 6; ++m)
        weight[m] = 1 / (squared_length[MEASURE_FIRST[m]] * squared_length[MEASURE_SECOND[m]]);
}

/* Add to the mean gradient what makes mean.change the exact change of s (3); `defect` is what is
   missing.  The derivative with respect to the end of the measures, or NULL, follows. */
static void correct_along_change(const pair_step *pair, const double change[6], double defect,
                                 double mean[6], double (*derivative)[6])
{
    double weight[6], length_rates[3], direction[6], square = 0;
    weights_of_measures(pair, weight, length_rates);
    for (int m = 0; m < 6; ++m) {
        direction[m] = weight[m] * change[m];
        square += direction[m] * change[m];
    }
    const double share = defect / square;
    if (derivative) {
        double of_share[6], of_square[6], of_direction[6][6] = {{0}};
        for (int m = 0; m < 6; ++m) {
            of_square[m] = 2 * direction[m];
            of_direction[m][m] = weight[m];
        }
        for (int m = 0; m < 6; ++m) {
            const int vectors[2] = {MEASURE_FIRST[m], MEASURE_SECOND[m]};
            for (int k = 0; k < 2; ++k) {
                const int n = MEASURE_OF[vectors[k]][vectors[k]];
                of_direction[m][n] -= length_rates[vectors[k]] * direction[m];
                of_square[n] -= length_rates[vectors[k]] * direction[m] * change[m];
            }
        }
        for (int n = 0; n < 6; ++n) {
            double sum = 0;
            for (int m = 0; m < 6; ++m) sum += change[m] * derivative[m][n];
            of_share[n] = (pair->end_gradient[n] - mean[n] - sum - share * of_square[n]) / square;
        }
        for (int m = 0; m < 6; ++m)
            for (int n = 0; n < 6; ++n)
                derivative[m][n] += share * of_direction[m][n] + direction[m] * of_share[n];
    }
    for (int m = 0; m < 6; ++m) mean[m] += share * direction[m];
}

/* The mean of ds/de along the straight path of the measures (2), corrected (3), and its derivative
   or NULL. */
static void mean_gradient(const pair_step *pair, const pair_vectors *middle, double mean[6],
                          double (*derivative)[6])
{
    double start[6], change[6], defect = pair->s1 - pair->s0;
    measures_of(&pair->start, start);
    change_of_measures(pair, middle, change);
    for (int m = 0; m < 6; ++m) mean[m] = 0;
    const int parts = pair->frame.of->is_rounded ? PARTS_OF_EDGES : 1;
    for (int g = 0; g < 2 * parts; ++g) {
        const double t = (g / 2 + GAUSS_POINTS[g % 2]) / parts;
        double measures[6], gradient[6];
        for (int m = 0; m < 6; ++m) measures[m] = start[m] + t * change[m];
        distance_derivatives(&pair->frame, measures, gradient, derivative, t / (2 * parts));
        for (int m = 0; m < 6; ++m) mean[m] += gradient[m] / (2 * parts);
    }
    for (int m = 0; m < 6; ++m) defect -= mean[m] * change[m];
    if (fabs(defect) > ROUND_OFF * (fabs(pair->s0) + fabs(pair->s1)))
        correct_along_change(pair, change, defect, mean, derivative);
}

/* The secant of the energy of a step; beyond the least distance that edges must keep it goes on as
   a straight line. */
static energy_secant secant_of_step(const pair_step *pair, int too_steep)
{
    if (!too_steep) return secant_of(pair->energy, pair->x0, pair->x1);
    const double least = LEAST_KEPT_DISTANCE * fmin(pair->x0, 1);
    energy_secant secant = secant_of(pair->energy, pair->x0, least);
    secant.slope += secant.derivative * (pair->x1 - least);
    return secant;
}

/* The stress of a step (1), and its derivative if it is wanted. */
static void stress_of_step(const pair_step *pair, int too_steep, int wants_tangent,
                           pair_stress *result)
{
    double mean[6], hessian[6][6] = {{0}};
    for (int i = 0; i < 3; ++i)
        for (int c = 0; c < 3; ++c)
            result->acting.row[i][c] = (pair->start.row[i][c] + pair->end.row[i][c]) / 2;
    mean_gradient(pair, &result->acting, mean, wants_tangent ? hessian : NULL);
    const energy_secant secant = secant_of_step(pair, too_steep);
    const double slope = secant.slope / pair->width;
    const double curvature = secant.derivative / (pair->width * pair->width);
    for (int m = 0; m < 6; ++m) result->stress[m] = pair->stiffness * slope * mean[m];
    if (!wants_tangent) return;
    for (int m = 0; m < 6; ++m)
        for (int n = 0; n < 6; ++n)
            result->derivative[m][n] =
                pair->stiffness * (slope * hessian[m][n] + curvature * mean[m] * pair->end_gradient[n]);
}

/* ---- force and tangent of the four points ---- */

/* Forces (12) on the points from those on the vectors r, a, b. */
static void force_on_points(const pair_frame *frame, const double on_vectors[3][3],
                            double *restrict force)
{
    const double(*of)[4] = frame->coefficients;
    for (int k = 0; k < 4; ++k)
        for (int c = 0; c < 3; ++c)
            force[3 * k + c] = of[0][k] * on_vectors[0][c] + of[1][k] * on_vectors[1][c] + of[2][k] * on_vectors[2][c];
}

/* Tangent (12, 12) of the points from that of the vectors r, a, b. */
static void tangent_of_points(const pair_frame *frame, double of_vectors[3][3][9],
                              double *restrict tangent)
{
    const double(*of)[4] = frame->coefficients;
    double half[9][12];
    for (int i = 0; i < 3; ++i)
        for (int c = 0; c < 3; ++c)
            for (int k = 0; k < 4; ++k)
                for (int d = 0; d < 3; ++d)
                    half[3 * i + c][3 * k + d] = of[0][k] * of_vectors[i][c][d] + of[1][k] * of_vectors[i][c][3 + d] +
                                                 of[2][k] * of_vectors[i][c][6 + d];
    for (int k = 0; k < 4; ++k)
        for (int c = 0; c < 3; ++c)
            for (int j = 0; j < 12; ++j)
                tangent[12 * (3 * k + c) + j] =
                    of[0][k] * half[c][j] + of[1][k] * half[3 + c][j] + of[2][k] * half[6 + c][j];
}

/* The derivative of De(acting)^T S with respect to the end of r, a, b: material part De^T D
   De(end), and the geometric part with the given share.  The derivative of the measure of vectors i
   and j by vector i is vector j, twice if they are the same. */
static void tangent_of_vectors(const pair_stress *stress, const pair_vectors *end,
                               double stress_matrix[3][3],
                               double geometric_share, double tangent[3][3][9])
{
    double end_rows[6][9] = {{0}}, products[6][9];
    for (int m = 0; m < 6; ++m)
        for (int c = 0; c < 3; ++c) {
            end_rows[m][3 * MEASURE_FIRST[m] + c] += end->row[MEASURE_SECOND[m]][c];
            end_rows[m][3 * MEASURE_SECOND[m] + c] += end->row[MEASURE_FIRST[m]][c];
        }
    for (int m = 0; m < 6; ++m) {
        const double *d = stress->derivative[m];
        for (int j = 0; j < 9; ++j)
            products[m][j] = d[0] * end_rows[0][j] + d[1] * end_rows[1][j] + d[2] * end_rows[2][j] +
                             d[3] * end_rows[3][j] + d[4] * end_rows[4][j] + d[5] * end_rows[5][j];
    }
    for (int i = 0; i < 3; ++i) {
        const double *of_r = products[MEASURE_OF[i][0]], *of_a = products[MEASURE_OF[i][1]];
        const double *of_b = products[MEASURE_OF[i][2]];
        for (int c = 0; c < 3; ++c) {
            const double r = stress->acting.row[0][c] * (1 + (i == 0));
            const double a = stress->acting.row[1][c] * (1 + (i == 1));
            const double b = stress->acting.row[2][c] * (1 + (i == 2));
            for (int j = 0; j < 9; ++j) tangent[i][c][j] = r * of_r[j] + a * of_a[j] + b * of_b[j];
            for (int j = 0; j < 3; ++j) tangent[i][c][3 * j + c] += geometric_share * stress_matrix[i][j];
        }
    }
}

/* Force De^T S on the points, and its derivative if it is wanted. */
static void force_and_tangent(const pair_step *pair, const pair_stress *stress,
                              double geometric_share, const pair_output *output)
{
    double stress_matrix[3][3] = {{0}}, on_vectors[3][3];
    for (int m = 0; m < 6; ++m) {
        stress_matrix[MEASURE_FIRST[m]][MEASURE_SECOND[m]] += stress->stress[m];
        stress_matrix[MEASURE_SECOND[m]][MEASURE_FIRST[m]] += stress->stress[m];
    }
    const double(*row)[3] = stress->acting.row;
    for (int i = 0; i < 3; ++i) {
        const double *of = stress_matrix[i];
        for (int c = 0; c < 3; ++c) on_vectors[i][c] = of[0] * row[0][c] + of[1] * row[1][c] + of[2] * row[2][c];
    }
    force_on_points(&pair->frame, on_vectors, output->force);
    if (!output->tangent) return;
    double of_vectors[3][3][9];
    tangent_of_vectors(stress, &pair->end, stress_matrix, geometric_share, of_vectors);
    tangent_of_points(&pair->frame, of_vectors, output->tangent);
}

/* ---- all pairs ---- */

/* Write force and tangent of pair i to `output`, and return what it does; nothing is written for
   NO_CONTACT. */
static enum pair_state evaluate_pair(const active_pairs *pairs, const contact_step *step,
                                     ptrdiff_t i, const pair_output *output)
{
    pair_step pair;
    set_up(pairs, step, i, &pair);
    const int has_passed =
        !is_boundary(pair.frame.of) && !pair.is_state && has_passed_through(&pair.frame, &pair.start,
                                                                          &pair.end);
    const int too_steep = step->push_back > 0 && !has_passed && is_too_steep(&pair);
    /* no energy is defined there; a point behind a penalised boundary still has one */
    const int is_below_zero = pair.x1 <= 0 && !too_steep && (pairs->law == BARRIER ||
                                                             !is_boundary(pair.frame.of));
    if ((has_passed || is_below_zero) && step->push_back > 0) {
        push_pair_back(&pair, has_passed, step->push_back, output);
        return PASSED;
    }
    if (!(pair.x0 < 1 || pair.x1 < 1)) return NO_CONTACT;
    pair_stress stress;
    if (pair.is_state) stress_of_state(&pair, &stress);
    else stress_of_step(&pair, too_steep, output->tangent != NULL, &stress);
    force_and_tangent(&pair, &stress, step->alpha * step->geometric_share, output);
    return too_steep ? PASSED : TOUCHES;
}

/* Enter force and tangent of pair i into all results that are wanted. */
static void add_response(const pair_list *pairs, ptrdiff_t i, const contact_response *response,
                         const pair_output *pair)
{
    const double *force = pair->force, *tangent = pair->tangent;
    const int32_t *points = pairs->points + 4 * i;
    if (response->point_forces)
        for (int k = 0; k < 4; ++k) {
            double *sum = response->point_forces + 3 * (ptrdiff_t)points[k];
            for (int c = 0; c < 3; ++c) sum[c] += force[3 * k + c];
        }
    if (response->pair_forces) memcpy(response->pair_forces + 12 * i, force, 12 * sizeof *force);
    if (response->pair_tangents) memcpy(response->pair_tangents + 144 * i, tangent,
                                        144 * sizeof *tangent);
    if (!response->blocks) return;
    for (int k = 0; k < 4; ++k)
        for (int l = 0; l < 4; ++l) {
            double *block = response->blocks + 9 * (ptrdiff_t)response->block_index[16 * i + 4 * k + l];
            for (int c = 0; c < 3; ++c)
                for (int d = 0; d < 3; ++d) block[3 * c + d] += tangent[12 * (3 * k + c) + 3 * l + d];
        }
}

/* Enter zeros into the results of pair i; what is summed over pairs stays. */
static void set_zero(ptrdiff_t i, const contact_response *response)
{
    if (response->pair_forces) memset(response->pair_forces + 12 * i, 0, 12 * sizeof(double));
    if (response->pair_tangents) memset(response->pair_tangents + 144 * i, 0, 144 * sizeof(double));
}

ptrdiff_t evaluate_pairs(const active_pairs *pairs, const contact_step *step,
                         const contact_response *response)
{
    double force[12], tangent[144];
    const int wants_tangent = response->blocks || response->pair_tangents;
    const pair_output output = {force, wants_tangent ? tangent : NULL};
    ptrdiff_t count = 0;
    for (ptrdiff_t i = 0; i < pairs->list.count; ++i) {
        const int is_idle =
            response->state_is_known ? response->state[i] == NO_CONTACT : is_out_of_range(pairs,
                                                                                          step, i);
        const enum pair_state state = is_idle ? NO_CONTACT : evaluate_pair(pairs, step, i, &output);
        response->state[i] = (uint8_t)state;
        if (state == NO_CONTACT) {
            set_zero(i, response);
            continue;
        }
        ++count;
        add_response(&pairs->list, i, response, &output);
    }
    return count;
}

/* ---- one state ---- */

/* s of one pair with rounded edges, from its closest points. */
static double rounded_distance(const active_pairs *pairs, const double *x, const double *parameters,
                               ptrdiff_t i)
{
    const stencil *of = STENCILS + pairs->list.kind[i];
    pair_frame frame = frame_of(of, shape_of(&pairs->list, i), pairs->rounding, pairs->width[i]);
    pair_vectors vectors = vectors_at(frame.coefficients, x, pairs->list.points + 4 * i);
    if (!is_boundary(of)) move_base(&frame, parameters[2 * i], parameters[2 * i + 1], &vectors);
    double gradient[6];
    return pair_distance(&frame, &vectors, gradient);
}

void pair_starts(const active_pairs *pairs, const double *x, const double *squared_distance,
                 const double *parameters, double *start)
{
    for (ptrdiff_t i = 0; i < pairs->list.count; ++i) {
        const stencil *of = STENCILS + pairs->list.kind[i];
        start[4 * i] = parameters[2 * i];
        start[4 * i + 1] = parameters[2 * i + 1];
        start[4 * i + 2] = of->length_of(squared_distance[i]);
        start[4 * i + 3] = rounded_distance(pairs, x, parameters, i);
    }
}

double stored_energy(const active_pairs *pairs, const double *x, const double *parameters,
                     double *scaled_distance)
{
    double sum = 0;
    for (ptrdiff_t i = 0; i < pairs->list.count; ++i) {
        const contact_energy energy = {pairs->law, STENCILS[pairs->list.kind[i]].is_linear};
        const double s = rounded_distance(pairs, x, parameters, i);
        scaled_distance[i] = (s - pairs->offset[i]) / pairs->width[i];
        sum += pairs->stiffness[i] * energy_of(energy, scaled_distance[i]);
    }
    return sum;
}

void unit_energies(const active_pairs *pairs, const double *scaled_distance, double *energy)
{
    for (ptrdiff_t i = 0; i < pairs->list.count; ++i) {
        const contact_energy b = {pairs->law, STENCILS[pairs->list.kind[i]].is_linear};
        energy[i] = energy_of(b, scaled_distance[i]);
    }
}
