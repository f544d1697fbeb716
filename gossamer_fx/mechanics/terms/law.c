/* Responses of a law at quadrature points, and the choice of strains: see law.h, and
   terms/element_energies.py for the iteration of which this is a part. */
#include "law.h"

#include <math.h>
#include <string.h>

/* For its functions of one cell, which are not those of another library. */
#include "../../core/forms/cells.c"

static inline double larger(double a, double b) { return a > b ? a : b; }

/* The number of the cheapest response that serves all points of a cell. */
static int cheapest_response(const point_law *law, ptrdiff_t cell)
{
    if (law->sort == NULL) return 0;
    const double *cases = law->work;
    call(law->sort, &law->cells, cell, law->work, law->point_count);
    for (ptrdiff_t k = 1; k < law->point_count; k++)
        if (cases[k] != cases[0]) return 0;
    return (int)cases[0];
}

/* Evaluate the responses in one cell. */
static void respond(const point_law *law, ptrdiff_t cell)
{
    const cell_function *f = law->responses + cheapest_response(law, cell);
    call(f, &law->cells, cell, law->work, law->point_count * law->response.size);
    set_in_cell(&law->response, cell, law->work);
}

void evaluate_responses(const point_law *law)
{
    for (ptrdiff_t k = 0; k < law->function_count; k++) read_constants(law->responses + k);
    for (ptrdiff_t cell = 0; cell < law->cells.count; cell++) respond(law, cell);
}

/* Solve the equations A x = b with A (m, m) and b in the last column of rows (m, m + 1); x replaces
   b.  Returns 0 if A is singular. */
static int solve(double *rows, ptrdiff_t m)
{
    const ptrdiff_t width = m + 1;
    for (ptrdiff_t i = 0; i < m; i++) {
        ptrdiff_t pivot = i;
        for (ptrdiff_t j = i + 1; j < m; j++)
            if (fabs(rows[j * width + i]) > fabs(rows[pivot * width + i])) pivot = j;
        if (rows[pivot * width + i] == 0) return 0;
        for (ptrdiff_t k = i; k < width; k++) {
            const double swapped = rows[i * width + k];
            rows[i * width + k] = rows[pivot * width + k];
            rows[pivot * width + k] = swapped;
        }
        for (ptrdiff_t j = i + 1; j < m; j++) {
            const double ratio = rows[j * width + i] / rows[i * width + i];
            for (ptrdiff_t k = i; k < width; k++) rows[j * width + k] -= ratio * rows[i * width + k];
        }
    }
    for (ptrdiff_t i = m - 1; i >= 0; i--) {
        double sum = rows[i * width + m];
        for (ptrdiff_t k = i + 1; k < m; k++) sum -= rows[i * width + k] * rows[k * width + m];
        rows[i * width + m] = sum / rows[i * width + i];
    }
    return 1;
}

static double largest_stiffness(const double *D, ptrdiff_t m)
{
    double largest = D[0];
    for (ptrdiff_t i = 1; i < m; i++) largest = larger(largest, D[i * (m + 1)]);
    return largest;
}

/* Forecast stress, stiffness and change of strain of one point (forecast, m + 2); the strain
   becomes the linear one. */
static void forecast_point(const double *linear, double *strain, const double *response,
                           ptrdiff_t m, double *forecast)
{
    const double *S = response;
    const double *D = response + m;
    double square = 0;
    for (ptrdiff_t i = 0; i < m; i++) {
        forecast[i] = S[i];
        for (ptrdiff_t j = 0; j < m; j++) forecast[i] += D[i * m + j] * (linear[j] - strain[j]);
        square += (linear[i] - strain[i]) * (linear[i] - strain[i]);
    }
    forecast[m] = largest_stiffness(D, m);
    forecast[m + 1] = sqrt(square);
    memcpy(strain, linear, (size_t)m * sizeof(double));
}

/* k of equation (5) where the strain of a point is to be chosen, zero where it stays the linear
   one. */
static double choice_stiffness(const strain_choice *choice, const double *response,
                               const double *forecast,
                               ptrdiff_t m, ptrdiff_t row)
{
    double error = 0;
    double size = 0;
    for (ptrdiff_t i = 0; i < m; i++) {
        error = larger(error, fabs(response[i] - forecast[i]));
        size = larger(size, larger(fabs(response[i]), fabs(forecast[i])));
    }
    const double k = choice->stiffness_ratio * larger(forecast[m], largest_stiffness(response + m,
                                                                                     m));
    const int is_far = error > choice->trigger * size && k > 0;
    choice->fruitless[row] += is_far && error > choice->fruitful_ratio * choice->last_error[row];
    choice->last_error[row] = is_far ? error : INFINITY;
    return is_far && choice->fruitless[row] < choice->max_fruitless ? k : 0;
}

/* Move the strain of a point from the linear one towards the one that has the forecast stress. */
static void move_strain(const strain_choice *choice, const double *response, const double *forecast,
                        ptrdiff_t m,
                        double k, double *strain)
{
    const ptrdiff_t width = m + 1;
    double *rows = choice->equations;
    for (ptrdiff_t i = 0; i < m; i++) {
        memcpy(rows + i * width, response + m + i * m, (size_t)m * sizeof(double));
        rows[i * width + i] += k;
        rows[i * width + m] = forecast[i] - response[i];
    }
    if (!solve(rows, m)) return;
    double square = 0;
    for (ptrdiff_t i = 0; i < m; i++) square += rows[i * width + m] * rows[i * width + m];
    /* No farther than the linear strain itself has moved. */
    const double length = sqrt(square);
    const double share = length > forecast[m + 1] ? forecast[m + 1] / length : 1;
    for (ptrdiff_t i = 0; i < m; i++) strain[i] += share * rows[i * width + m];
}

int choose_strains(const point_law *law, const strain_choice *choice)
{
    const ptrdiff_t m = law->strain_size;
    int any = 0;
    for (ptrdiff_t k = 0; k < law->function_count; k++) read_constants(law->responses + k);
    for (ptrdiff_t cell = 0; cell < law->cells.count; cell++) {
        const int32_t *rows = law->strain.nodes + cell * law->point_count;
        for (ptrdiff_t k = 0; k < law->point_count; k++)
            forecast_point(choice->linear_strain + rows[k] * m, law->strain.values + rows[k] * m,
                           law->response.values + rows[k] * law->response.size, m,
                           choice->forecast + k * (m + 2));
        respond(law, cell);
        int is_chosen = 0;
        for (ptrdiff_t k = 0; k < law->point_count; k++) {
            const double *response = law->response.values + rows[k] * law->response.size;
            const double *forecast = choice->forecast + k * (m + 2);
            const double stiffness = choice_stiffness(choice, response, forecast, m, rows[k]);
            if (stiffness <= 0) continue;
            move_strain(choice, response, forecast, m, stiffness, law->strain.values + rows[k] * m);
            is_chosen = 1;
        }
        if (is_chosen) respond(law, cell);
        any |= is_chosen;
    }
    return any;
}
