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

/* Changes of strain below this part of the strains' squares, or of this square, need no correction. */
static const double SMALLEST_CHANGE = 1e-10;
static const double SMALLEST_SQUARE = 1e-40;
/* Round-off of a difference of energies, over their sum. */
static const double ENERGY_ROUND_OFF = 4 * DBL_EPSILON;

typedef struct {
    double R[9]; /* strains in the axes of the film, of strains in its frame */
    film_stiffness C;
    double residual;
} film_law;

static film_law law_of(const double *numbers)
{
    const double c = numbers[0];
    const double s = numbers[1];
    const double R[9] = {c * c, s * s, c * s, s * s, c * c, -c * s, -2 * c * s, 2 * c * s, c * c - s * s};
    film_law law = {.residual = numbers[6]};
    memcpy(law.R, R, sizeof R);
    law.C = film_stiffness_of(numbers[2], numbers[3], numbers[4], numbers[5]);
    return law;
}

static inline double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static void to_axes(const film_law *law, const double *strain, double *e)
{
    for (int i = 0; i < 3; i++) e[i] = dot(law->R + 3 * i, strain);
}

/* Stress R^T S and derivative R^T D R in the frame of the film: values (12). */
static void to_frame(const film_law *law, const film_response *response, const double *correction, double *values)
{
    const double *R = law->R;
    const double *D = response->D;
    double full[9] = {D[0], D[1], D[2], D[1], D[3], D[4], D[2], D[4], D[5]};
    for (int i = 0; i < 9 && correction != NULL; i++) full[i] += correction[i];
    double DR[9];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            DR[3 * i + j] = full[3 * i] * R[j] + full[3 * i + 1] * R[3 + j] + full[3 * i + 2] * R[6 + j];
    for (int i = 0; i < 3; i++) {
        values[i] = R[i] * response->S[0] + R[3 + i] * response->S[1] + R[6 + i] * response->S[2];
        for (int j = 0; j < 3; j++)
            values[3 + 3 * i + j] = R[i] * DR[j] + R[3 + i] * DR[3 + j] + R[6 + i] * DR[6 + j];
    }
}

/* Mix the response of relaxed film with that of taut film at the strain e, whose derivative has a weight. */
static void add_residual(const film_law *law, const double *e, double derivative_weight, film_response *response)
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

/* Add the energy that an averaged stress misses along the change of strain d, as terms/discrete_gradient.py does for
   other laws: S += (missing/|d|^2) d with missing = W(e1) - W(e0) - S.d.  The derivative of that goes to D (9), which
   is not symmetric; returns whether there is any. */
static int add_correction(const double *e0, const double *e1, averaged_film *average, double *D)
{
    const double noise = ENERGY_ROUND_OFF * average->energy;
    if (fabs(average->missing) <= noise) return 0;
    double d[3];
    for (int i = 0; i < 3; i++) d[i] = e1[i] - e0[i];
    const double square = dot(d, d);
    const double smallest = SMALLEST_CHANGE * (dot(e0, e0) + dot(e1, e1));
    if (!(square > smallest && square > SMALLEST_SQUARE)) return 0;
    const double missing = average->missing - (average->missing > 0 ? noise : -noise);
    double *S = average->response.S;
    const double *A = average->response.D;
    const double change[3] = {A[0] * d[0] + A[1] * d[1] + A[2] * d[2], A[1] * d[0] + A[3] * d[1] + A[4] * d[2],
                              A[2] * d[0] + A[4] * d[1] + A[5] * d[2]};
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            const double slope = average->end_stress[j] - S[j] - change[j]; /* of `missing`, by e1 */
            D[3 * i + j] = d[i] * (slope - 2 * missing / square * d[j]) / square + (i == j) * missing / square;
        }
    for (int i = 0; i < 3; i++) S[i] += missing / square * d[i];
    return 1;
}

static void average_response(CELL_ARGUMENTS)
{
    IGNORE_GEOMETRY;
    const int points = (int)constants[0];
    for (int k = 0; k < points; k++) {
        const film_law law = law_of(arguments + 6 * points + LAW * k);
        double e0[3];
        double e1[3];
        double middle[3];
        double correction[9] = {0};
        to_axes(&law, arguments + 3 * k, e0);
        to_axes(&law, arguments + 3 * (points + k), e1);
        averaged_film average;
        memset(&average, 0, sizeof average);
        if (law.residual < 1) averaged_response(&law.C, e0, e1, &average);
        const int is_corrected = add_correction(e0, e1, &average, correction);
        for (int i = 0; i < 9; i++) correction[i] *= 1 - law.residual;
        for (int i = 0; i < 3; i++) middle[i] = (e0[i] + e1[i]) / 2;
        add_residual(&law, middle, 0.5, &average.response);
        to_frame(&law, &average.response, is_corrected ? correction : NULL, values + RESPONSE * k);
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
        to_frame(&law, &response, NULL, values + RESPONSE * k);
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
