/* Stress and energy of film that bears no compression: see relaxed_film.h. */
#include "relaxed_film.h"

#include <math.h>
#include <string.h>

/* A compressive stress of this part of the largest stiffness is round-off.  Otherwise the state of an unstrained film
   would be random, and its tangent with it. */
static const double ROUND_OFF = 1e-12;

/* Newton's step for the angle [rad] that is the last one: the next would be its square. */
static const double CONVERGED_STEP = 1e-8;
/* Usual films need 3 to 5, braids with a condition of 300 up to 10; bisection alone would need 50. */
enum { MAX_ITERATIONS = 60, MAX_WARM_ITERATIONS = 4 };

/* The wrinkle strain may be negative by this part of the strain before another maximum is looked for. */
static const double NEGATIVE_WRINKLE = 1e-9;
/* Directions of the grid on which the largest maximum is looked for. */
enum { GRID_DIRECTIONS = 48 };
static const double PI = 3.14159265358979323846;

/* Products with t x t, and their first and second derivatives by the angle of t. */
typedef struct {
    double value, first, second;
} along_direction;

film_stiffness film_stiffness_of(double C11, double C12, double C22, double C66)
{
    const double determinant = C11 * C22 - C12 * C12;
    film_stiffness C = {.C11 = C11, .C12 = C12, .C22 = C22, .C66 = C66};
    C.F11 = C22 / determinant;
    C.F12 = -C12 / determinant;
    C.F22 = C11 / determinant;
    C.F66 = 1 / C66;
    C.margin = ROUND_OFF * (C11 > C22 ? C11 : C22);
    return C;
}

void taut_stress(const film_stiffness *C, const double *e, double *S)
{
    S[0] = C->C11 * e[0] + C->C12 * e[1];
    S[1] = C->C12 * e[0] + C->C22 * e[1];
    S[2] = C->C66 * e[2];
}

void add_stiffness(const film_stiffness *C, double weight, double *D)
{
    D[0] += weight * C->C11;
    D[1] += weight * C->C12;
    D[3] += weight * C->C12;
    D[4] += weight * C->C22;
    D[8] += weight * C->C66;
}

enum film_state film_state_at(const film_stiffness *C, const double *e)
{
    double S[3];
    taut_stress(C, e, S);
    const double S1 = S[0] + C->margin;
    const double S2 = S[1] + C->margin;
    if (S1 + S2 >= 0 && S1 * S2 >= S[2] * S[2]) return TAUT;
    if (e[0] + e[1] <= 0 && e[0] * e[1] >= e[2] * e[2] / 4) return SLACK;
    return WRINKLED;
}

/* ---- the direction of the tension -------------------------------------------------------------------------------- */

static inline direction unit(double x, double y)
{
    const double length = sqrt(x * x + y * y);
    return (direction){x / length, y / length};
}

static inline double sine_between(direction a, direction b) { return a.cosine * b.sine - a.sine * b.cosine; }

static inline along_direction strain_along(const double *e, direction t)
{
    const double double_sine = 2 * t.cosine * t.sine;
    const double double_cosine = t.cosine * t.cosine - t.sine * t.sine;
    const double difference = e[1] - e[0];
    along_direction along;
    along.value = t.cosine * t.cosine * e[0] + t.sine * t.sine * e[1] + t.cosine * t.sine * e[2];
    along.first = double_sine * difference + double_cosine * e[2];
    along.second = 2 * (double_cosine * difference - double_sine * e[2]);
    return along;
}

/* F_tt = F11 c^4 + F22 s^4 + K c^2 s^2 with K = 2 F12 + F66, in double angles. */
static inline along_direction compliance_along(const film_stiffness *C, direction t)
{
    const double c2 = t.cosine * t.cosine;
    const double s2 = t.sine * t.sine;
    const double K = 2 * C->F12 + C->F66;
    const double double_sine = 2 * t.cosine * t.sine;
    const double double_cosine = c2 - s2;
    /* By the angle: c^2 has the derivative -sin 2a, s^2 has sin 2a. */
    const double slope = -2 * C->F11 * c2 + 2 * C->F22 * s2 + K * double_cosine;
    along_direction along;
    along.value = C->F11 * c2 * c2 + C->F22 * s2 * s2 + K * c2 * s2;
    along.first = double_sine * slope;
    along.second = 2 * double_cosine * slope + 2 * double_sine * double_sine * (C->F11 + C->F22 - K);
    return along;
}

/* The stress along t [N/m]. */
static inline double tension_along(along_direction e, along_direction F) { return e.value / F.value; }

/* The strain that wrinkles take up across t; the stress of t is that of the film if it is not negative. */
static double wrinkle_strain(const film_stiffness *C, const double *e, direction t)
{
    const double c2 = t.cosine * t.cosine;
    const double s2 = t.sine * t.sine;
    const double cs = t.cosine * t.sine;
    const double tension = tension_along(strain_along(e, t), compliance_along(C, t));
    const double strain1 = C->F11 * c2 + C->F12 * s2;
    const double strain2 = C->F12 * c2 + C->F22 * s2;
    const double across = s2 * strain1 + c2 * strain2 - cs * C->F66 * cs;
    return tension * across - (s2 * e[0] + c2 * e[1] - cs * e[2]);
}

static double magnitude(const double *e) { return fabs(e[0]) + fabs(e[1]) + fabs(e[2]); }

static int is_solution(const film_stiffness *C, const double *e, direction t)
{
    return strain_along(e, t).value > 0 && wrinkle_strain(C, e, t) >= -NEGATIVE_WRINKLE * magnitude(e);
}

/* Newton's step [rad] towards a maximum of e_tt^2/F_tt, NAN where that is not concave; phi has the sign of its slope. */
static double newton_step(const film_stiffness *C, const double *e, direction t, double *phi)
{
    const along_direction strain = strain_along(e, t);
    const along_direction F = compliance_along(C, t);
    *phi = strain.first * F.value - strain.value * F.first / 2;
    const double slope = strain.second * F.value + (strain.first * F.first - strain.value * F.second) / 2;
    return slope < 0 ? -*phi / slope : NAN;
}

static inline direction turned(direction t, double step)
{
    return unit(t.cosine - step * t.sine, t.sine + step * t.cosine);
}

/* The maximum between two directions, by Newton's iteration that bisects where a step leaves the bracket. */
static direction bracketed_maximum(const film_stiffness *C, const double *e, direction t, direction low, direction high)
{
    for (int i = 0; i < MAX_ITERATIONS; i++) {
        double phi;
        const double step = newton_step(C, e, t, &phi);
        if (phi > 0)
            low = t;
        else
            high = t;
        const direction next = turned(t, step);
        const int is_inside = sine_between(low, next) >= 0 && sine_between(next, high) >= 0;
        if (is_inside && fabs(step) < 1) {
            t = next;
            if (fabs(step) < CONVERGED_STEP) break;
        } else {
            t = unit(low.cosine + high.cosine, low.sine + high.sine);
        }
    }
    return t;
}

/* The maximum around the direction of the largest strain, where e_tt is positive. */
static direction maximum_near_largest_strain(const film_stiffness *C, const double *e)
{
    const double mean = (e[0] + e[1]) / 2;
    const double x = (e[0] - e[1]) / 2;
    const double y = e[2] / 2;
    const double radius = sqrt(x * x + y * y);
    direction t = {1, 0};
    if (radius > 0) t = x >= 0 ? unit(radius + x, y) : (y >= 0 ? unit(y, radius - x) : unit(-y, x - radius));
    direction low = {t.sine, -t.cosine};
    direction high = {-t.sine, t.cosine};
    if (mean < radius) {
        /* e_tt is zero at this tangent of the angle from t. */
        const double tangent = sqrt((mean > -radius ? mean + radius : 0) / (radius - mean));
        low = turned(t, -tangent);
        high = turned(t, tangent);
    }
    return bracketed_maximum(C, e, t, low, high);
}

/* The largest of all maxima: film whose shear stiffness is far above that of its axes may have two. */
static direction largest_maximum(const film_stiffness *C, const double *e)
{
    double largest = 0;
    double angle = 0;
    const double spacing = PI / GRID_DIRECTIONS;
    for (int i = 0; i < GRID_DIRECTIONS; i++) {
        const direction t = {cos(i * spacing), sin(i * spacing)};
        const double strain = strain_along(e, t).value;
        const double energy = strain > 0 ? strain * strain / compliance_along(C, t).value : 0;
        if (energy <= largest) continue;
        largest = energy;
        angle = i * spacing;
    }
    const direction low = {cos(angle - spacing), sin(angle - spacing)};
    const direction high = {cos(angle + spacing), sin(angle + spacing)};
    return bracketed_maximum(C, e, (direction){cos(angle), sin(angle)}, low, high);
}

direction tension_direction(const film_stiffness *C, const double *e, const direction *near)
{
    if (near != NULL) {
        direction t = *near;
        for (int i = 0; i < MAX_WARM_ITERATIONS; i++) {
            double phi;
            const double step = newton_step(C, e, t, &phi);
            if (!(fabs(step) < 0.5)) break;
            t = turned(t, step);
            if (fabs(step) < CONVERGED_STEP && is_solution(C, e, t)) return t;
        }
    }
    const direction t = maximum_near_largest_strain(C, e);
    return is_solution(C, e, t) ? t : largest_maximum(C, e);
}

/* ---- stress and energy ------------------------------------------------------------------------------------------- */

/* W is the maximum over the angle a of f = e_tt^2/(2 F_tt): S = df/de, D = d2f/de2 - (d2f/de da)^2/(d2f/da2).  With the
   tension s = e_tt/F_tt and T = t x t,

       D = T T/F_tt - s v v/g,   v = T' - F'/(2 F) T,   g = e'' + s (F'^2/(4 F) - F''/2) < 0 */
void add_wrinkled(const film_stiffness *C, const double *e, direction t, double weight, double derivative_weight,
                  film_response *sum)
{
    const along_direction strain = strain_along(e, t);
    const along_direction F = compliance_along(C, t);
    const double tension = strain.value > 0 ? tension_along(strain, F) : 0;
    const double double_sine = 2 * t.cosine * t.sine;
    const double T[3] = {t.cosine * t.cosine, t.sine * t.sine, t.cosine * t.sine};
    const double T_first[3] = {-double_sine, double_sine, T[0] - T[1]};
    const double g = strain.second + tension * (F.first * F.first / (4 * F.value) - F.second / 2);
    const double turning = g < 0 ? -tension / g : 0;
    double v[3];
    for (int i = 0; i < 3; i++) v[i] = T_first[i] - F.first / (2 * F.value) * T[i];
    for (int i = 0; i < 3; i++) {
        sum->S[i] += weight * tension * T[i];
        for (int j = 0; j < 3; j++)
            sum->D[3 * i + j] += derivative_weight * (T[i] * T[j] / F.value + turning * v[i] * v[j]);
    }
}

double wrinkled_density(const film_stiffness *C, const double *e, direction t)
{
    const double strain = strain_along(e, t).value;
    return strain > 0 ? strain * strain / (2 * compliance_along(C, t).value) : 0;
}

double relaxed_density(const film_stiffness *C, const double *e)
{
    const enum film_state state = film_state_at(C, e);
    if (state == SLACK) return 0;
    if (state == TAUT) {
        double S[3];
        taut_stress(C, e, S);
        return (S[0] * e[0] + S[1] * e[1] + S[2] * e[2]) / 2;
    }
    return wrinkled_density(C, e, tension_direction(C, e, NULL));
}

void relaxed_response(const film_stiffness *C, const double *e, film_response *response)
{
    memset(response, 0, sizeof *response);
    const enum film_state state = film_state_at(C, e);
    if (state == WRINKLED) add_wrinkled(C, e, tension_direction(C, e, NULL), 1, 1, response);
    if (state != TAUT) return;
    taut_stress(C, e, response->S);
    add_stiffness(C, 1, response->D);
}
