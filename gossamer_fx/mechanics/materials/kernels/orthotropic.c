/* Responses and energy of an orthotropic film at the points of a cell: see orthotropic.h. */
#include "orthotropic.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "relaxed_film.h"

/* The functions that FFCx makes have an argument more from version 0.10 on. */
#ifdef KERNELS_TAKE_DATA
#define CELL_ARGUMENTS                                                                                            \
    double *values, const double *arguments, const double *constants, const double *geometry, const int *facet,   \
        const uint8_t *permutation, void *data
#define IGNORE_DATA (void)data
#else
#define CELL_ARGUMENTS                                                                                            \
    double *values, const double *arguments, const double *constants, const double *geometry, const int *facet,   \
        const uint8_t *permutation
#define IGNORE_DATA (void)0
#endif
#define IGNORE_GEOMETRY ((void)geometry, (void)facet, (void)permutation, IGNORE_DATA)

/* Numbers of a response and of a law at a point. */
enum { RESPONSE = 12, LAW = 7 };

/* Changes of strain below this part of the strains' squares, or of this square, need no correction.
   */
static const double SMALLEST_CHANGE = 1e-10;
static const double SMALLEST_SQUARE = 1e-40;
/* Round-off of a difference of energies, over their sum. */
static const double ENERGY_ROUND_OFF = 4 * DBL_EPSILON;

typedef struct {
    direction axis; /* the first axis of the film in its frame */
    film_stiffness C;
    double residual;
} film_law;

static film_law law_of(const double *numbers)
{
    film_law law = {.axis = {numbers[0], numbers[1]}, .residual = numbers[6]};
    law.C = film_stiffness_of(numbers[2], numbers[3], numbers[4], numbers[5]);
    return law;
}

static inline double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/* A strain in the axes of the film, of one in its frame. */
static void to_axes(const film_law *law, const double *strain, double *e)
{
    const double c = law->axis.cosine;
    const double s = law->axis.sine;
    e[0] = c * c * strain[0] + s * s * strain[1] + c * s * strain[2];
    e[1] = s * s * strain[0] + c * c * strain[1] - c * s * strain[2];
    e[2] = 2 * c * s * (strain[1] - strain[0]) + (c * c - s * s) * strain[2];
}

/* Stress and derivative in the frame of the film, of those in its axes: values (12). */
static void to_frame(const film_law *law, const film_response *response, double *values)
{
    film_response in_frame = {{0}, {0}};
    add_from_basis(law->axis, response, &in_frame);
    memcpy(values, in_frame.S, sizeof in_frame.S);
    const double *D = in_frame.D;
    const double full[9] = {D[0], D[1], D[2], D[1], D[3], D[4], D[2], D[4], D[5]};
    memcpy(values + 3, full, sizeof full);
}

/* Mix the response of relaxed film with that of taut film at the strain e, whose derivative has a
   weight. */
static void add_residual(const film_law *law, const double *e, double derivative_weight,
                         film_response *response)
{
    const double u = law->residual;
    if (u == 0) return;
    double S[3];
    taut_stress(&law->C, e, S);
    for (int i = 0; i < 3; i++) response->S[i] = (1 - u) * response->S[i] + u * S[i];
    for (int i = 0; i < 6; i++) response->D[i] *= 1 - u;
    add_stiffness(&law->C, u * derivative_weight, response->D);
}

static double density_at(const film_law *law, const double *e)
{
    const double relaxed = law->residual < 1 ? relaxed_density(&law->C, e) : 0;
    if (law->residual == 0) return relaxed;
    double S[3];
    taut_stress(&law->C, e, S);
    return (1 - law->residual) * relaxed + law->residual * dot(S, e) / 2;
}

static void response_at(const film_law *law, const double *e, film_response *response)
{
    memset(response, 0, sizeof *response);
    if (law->residual < 1) relaxed_response(&law->C, e, response);
    add_residual(law, e, 1, response);
}

/* The stress at the end of a path in the frame of the film. */
static void end_stress_in_frame(const film_law *law, const averaged_film *average, const double *e1,
                                double *S)
{
    double at_end[3];
    double taut[3];
    taut_stress(&law->C, e1, taut);
    for (int i = 0; i < 3; i++) at_end[i] = (1 - law->residual) * average->end_stress[i] + law->residual * taut[i];
    const double c = law->axis.cosine;
    const double s = law->axis.sine;
    S[0] = c * c * at_end[0] + s * s * at_end[1] - 2 * c * s * at_end[2];
    S[1] = s * s * at_end[0] + c * c * at_end[1] + 2 * c * s * at_end[2];
    S[2] = c * s * (at_end[0] - at_end[1]) + (c * c - s * s) * at_end[2];
}

/* Add the energy that an averaged stress misses along the change of strain d, as
   terms/discrete_gradient.py does for other laws: S += (missing/|d|^2) d with missing = W(e1) -
   W(e0) - S.d.  The derivative of that is not symmetric.  All is in the frame of the film: strains
   e0 and e1, stress at the end, and values (12). */
static void add_correction(double missing, double noise, const double *e0, const double *e1,
                           const double *end_stress,
                           double *values)
{
    double d[3];
    for (int i = 0; i < 3; i++) d[i] = e1[i] - e0[i];
    const double square = dot(d, d);
    const double smallest = SMALLEST_CHANGE * (dot(e0, e0) + dot(e1, e1));
    if (!(square > smallest && square > SMALLEST_SQUARE)) return;
    double *S = values;
    double *D = values + 3;
    /* What is within round-off is cut off, not rounded: the correction stays continuous. */
    const double share = (missing - (missing > 0 ? noise : -noise)) / square;
    double slope[3]; /* of `missing`, by e1 */
    for (int j = 0; j < 3; j++) slope[j] = end_stress[j] - S[j] - dot(D + 3 * j, d);
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) D[3 * i + j] += d[i] * (slope[j] - 2 * share * d[j]) / square;
        D[4 * i] += share;
        S[i] += share * d[i];
    }
}

static void average_at_point(const film_law *law, const double *start, const double *end,
                             double *values)
{
    double e0[3];
    double e1[3];
    double middle[3];
    to_axes(law, start, e0);
    to_axes(law, end, e1);
    averaged_film average;
    memset(&average, 0, sizeof average);
    if (law->residual < 1) averaged_response(&law->C, e0, e1, &average);
    for (int i = 0; i < 3; i++) middle[i] = (e0[i] + e1[i]) / 2;
    add_residual(law, middle, 0.5, &average.response);
    to_frame(law, &average.response, values);
    const double missing = (1 - law->residual) * average.missing;
    const double noise = (1 - law->residual) * ENERGY_ROUND_OFF * average.energy;
    if (fabs(missing) <= noise) return;
    double end_stress[3];
    end_stress_in_frame(law, &average, e1, end_stress);
    add_correction(missing, noise, start, end, end_stress, values);
}

static void average_response(CELL_ARGUMENTS)
{
    IGNORE_GEOMETRY;
    const int points = (int)constants[0];
    for (int k = 0; k < points; k++) {
        const film_law law = law_of(arguments + 6 * points + LAW * k);
        average_at_point(&law, arguments + 3 * k, arguments + 3 * (points + k),
                         values + RESPONSE * k);
    }
}

static void end_response(CELL_ARGUMENTS)
{
    IGNORE_GEOMETRY;
    const int points = (int)constants[0];
    for (int k = 0; k < points; k++) {
        const film_law law = law_of(arguments + 6 * points + LAW * k);
        double e1[3];
        to_axes(&law, arguments + 3 * (points + k), e1);
        film_response response;
        response_at(&law, e1, &response);
        to_frame(&law, &response, values + RESPONSE * k);
    }
}

static void density(CELL_ARGUMENTS)
{
    IGNORE_GEOMETRY;
    const int points = (int)constants[0];
    for (int k = 0; k < points; k++) {
        const film_law law = law_of(arguments + 6 * points + LAW * k);
        double e0[3];
        to_axes(&law, arguments + 3 * k, e0);
        values[k] = density_at(&law, e0);
    }
}

uintptr_t orthotropic_function(int quantity)
{
    if (quantity == PATH_AVERAGE) return (uintptr_t)average_response;
    return quantity == END_POINT ? (uintptr_t)end_response : (uintptr_t)density;
}
