/* Stress and energy of film that bears no compression: see relaxed_film.h. */
#include "relaxed_film.h"

#include <math.h>
#include <string.h>

#include "polynomials.h"

/* A compressive stress of this part of the largest stiffness is round-off.  Otherwise the state of
   an unstrained film would be random, and its tangent with it. */
static const double ROUND_OFF = 1e-12;

/* Halley's step, as an angle, that is the last one: the error that it leaves is of the order of its
   cube. */
static const double CONVERGED_STEP = 1e-5;
/* Usual films need 2 to 4, braids with a condition of 300 up to 8; bisection alone would need 50.
   */
enum { MAX_ITERATIONS = 60 };
/* From a direction nearby; where more are needed the bracket is safer. */
enum { NEAR_ITERATIONS = 6 };
/* tau of a direction across m, where e_tt is positive all around. */
static const double LARGEST_TAU = 1e6;

/* The wrinkle strain may be negative by this part of the strain before another maximum is looked
   for. */
static const double NEGATIVE_WRINKLE = 1e-9;
/* Directions of the grid on which the largest maximum is looked for. */
enum { GRID_DIRECTIONS = 48 };
static const double PI = 3.14159265358979323846;

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
    D[3] += weight * C->C22;
    D[5] += weight * C->C66;
}

static enum film_state film_state_at(const film_stiffness *C, const double *e)
{
    double S[3];
    taut_stress(C, e, S);
    const double S1 = S[0] + C->margin;
    const double S2 = S[1] + C->margin;
    if (S1 + S2 >= 0 && S1 * S2 >= S[2] * S[2]) return TAUT;
    if (e[0] + e[1] <= 0 && e[0] * e[1] >= e[2] * e[2] / 4) return SLACK;
    return WRINKLED;
}

/* ---- polynomials in a basis
   -------------------------------------------------------------------------------------- */

direction_basis basis_along(const film_stiffness *C, direction m)
{
    const double c2 = m.cosine * m.cosine;
    const double s2 = m.sine * m.sine;
    const double cs = m.cosine * m.sine;
    const double difference = c2 - s2;
    const double K = 2 * C->F12 + C->F66;
    /* F11 t1^4 + F22 t2^4 + K t1^2 t2^2 with t1 = c - tau s, t2 = s + tau c. */
    direction_basis basis = {.m = m};
    basis.F[0] = C->F11 * c2 * c2 + C->F22 * s2 * s2 + K * cs * cs;
    basis.F[1] = cs * (4 * (C->F22 * s2 - C->F11 * c2) + 2 * K * difference);
    basis.F[2] = 6 * cs * cs * (C->F11 + C->F22) + K * (difference * difference - 2 * cs * cs);
    basis.F[3] = cs * (4 * (C->F22 * c2 - C->F11 * s2) - 2 * K * difference);
    basis.F[4] = C->F11 * s2 * s2 + C->F22 * c2 * c2 + K * cs * cs;
    return basis;
}

void strain_polynomial(const direction_basis *basis, const double *e, double *a)
{
    const double c = basis->m.cosine;
    const double s = basis->m.sine;
    a[0] = c * c * e[0] + s * s * e[1] + c * s * e[2];
    a[1] = 2 * c * s * (e[1] - e[0]) + (c * c - s * s) * e[2];
    a[2] = s * s * e[0] + c * c * e[1] - c * s * e[2];
}

void slope_polynomial(const direction_basis *basis, const double *a, double *P)
{
    const double *F = basis->F;
    P[0] = 2 * a[1] * F[0] - a[0] * F[1];
    P[1] = 4 * a[2] * F[0] + a[1] * F[1] - 2 * a[0] * F[2];
    P[2] = 3 * (a[2] * F[1] - a[0] * F[3]);
    P[3] = 2 * a[2] * F[2] - a[1] * F[3] - 4 * a[0] * F[4];
    P[4] = a[2] * F[3] - 2 * a[1] * F[4];
}

static inline direction unit(double x, double y)
{
    const double length = sqrt(x * x + y * y);
    return (direction){x / length, y / length};
}

static inline direction turned(direction m, double tau)
{
    return unit(m.cosine - tau * m.sine, m.sine + tau * m.cosine);
}

/* ---- the direction of the tension
   -------------------------------------------------------------------------------- */

/* The root of P at which it falls, between low and high, by Halley's iteration that bisects the
   angle where a step leaves the bracket. */
static double bracketed_root(const double *P, double low, double high)
{
    double tau = 0;
    for (int i = 0; i < MAX_ITERATIONS; i++) {
        const double value = value4(P, tau);
        const double slope = slope4(P, tau);
        if (value > 0)
            low = tau;
        else
            high = tau;
        const double next = tau - halley_step(value, slope, curvature4(P, tau));
        if (slope < 0 && next >= low && next <= high) {
            const double angle = fabs(next - tau) / (1 + tau * tau);
            tau = next;
            if (angle < CONVERGED_STEP) break;
        } else {
            tau = tan((atan(low) + atan(high)) / 2);
        }
    }
    return tau;
}

direction direction_of_largest_strain(const double *e)
{
    const double x = (e[0] - e[1]) / 2;
    const double y = e[2] / 2;
    const double radius = sqrt(x * x + y * y);
    if (radius == 0) return (direction){1, 0};
    if (x >= 0) return unit(radius + x, y);
    return y >= 0 ? unit(y, radius - x) : unit(-y, x - radius);
}

/* The maximum around the direction of the largest strain, where e_tt is positive. */
static direction maximum_near_largest_strain(const film_stiffness *C, const double *e)
{
    const direction_basis basis = basis_along(C, direction_of_largest_strain(e));
    double a[3];
    double P[5];
    strain_polynomial(&basis, e, a);
    slope_polynomial(&basis, a, P);
    const double limit = a[2] < 0 && a[0] >= 0 ? sqrt(a[0] / -a[2]) : LARGEST_TAU;
    return turned(basis.m, bracketed_root(P, -limit, limit));
}

/* The largest of all maxima: film whose shear stiffness is far above that of its axes may have two.
   */
static direction largest_maximum(const film_stiffness *C, const double *e)
{
    const direction_basis axes = basis_along(C, (direction){1, 0});
    const double spacing = PI / GRID_DIRECTIONS;
    double a[3];
    strain_polynomial(&axes, e, a);
    double largest = 0;
    double best = 0;
    for (int i = 0; i < GRID_DIRECTIONS; i++) {
        const double tau = tan((i + 0.5) * spacing);
        const double strain = value2(a, tau);
        const double energy = strain > 0 ? strain * strain / value4(axes.F, tau) : 0;
        if (energy <= largest) continue;
        largest = energy;
        best = (i + 0.5) * spacing;
    }
    const direction_basis basis = basis_along(C, (direction){cos(best), sin(best)});
    double P[5];
    strain_polynomial(&basis, e, a);
    slope_polynomial(&basis, a, P);
    return turned(basis.m, bracketed_root(P, -tan(spacing), tan(spacing)));
}

/* Whether the strain that wrinkles take up across t is not negative: then t is the direction of the
   tension. */
static int is_solution(const film_stiffness *C, const double *e, direction t)
{
    const double c2 = t.cosine * t.cosine;
    const double s2 = t.sine * t.sine;
    const double cs = t.cosine * t.sine;
    const double strain1 = C->F11 * c2 + C->F12 * s2;
    const double strain2 = C->F12 * c2 + C->F22 * s2;
    const double along = c2 * strain1 + s2 * strain2 + cs * C->F66 * cs;
    const double across = s2 * strain1 + c2 * strain2 - cs * C->F66 * cs;
    const double e_tt = c2 * e[0] + s2 * e[1] + cs * e[2];
    const double e_nn = s2 * e[0] + c2 * e[1] - cs * e[2];
    const double size = fabs(e[0]) + fabs(e[1]) + fabs(e[2]);
    return e_tt > 0 && e_tt * across / along - e_nn >= -NEGATIVE_WRINKLE * size;
}

direction tension_direction(const film_stiffness *C, const double *e)
{
    const direction t = maximum_near_largest_strain(C, e);
    return is_solution(C, e, t) ? t : largest_maximum(C, e);
}

direction tension_direction_near(const film_stiffness *C, const double *e, direction near)
{
    const direction_basis basis = basis_along(C, near);
    double a[3];
    double P[5];
    strain_polynomial(&basis, e, a);
    slope_polynomial(&basis, a, P);
    double tau = 0;
    double step = 1;
    for (int i = 0; i < NEAR_ITERATIONS && fabs(step) > CONVERGED_STEP; i++) {
        step = halley_step(value4(P, tau), slope4(P, tau), curvature4(P, tau));
        tau -= step;
    }
    if (!(fabs(step) <= CONVERGED_STEP)) return tension_direction(C, e);
    /* Equation (1) is convex: a stationary point whose wrinkles are not negative is the solution.
       */
    const direction t = turned(basis.m, tau);
    return is_solution(C, e, t) ? t : tension_direction(C, e);
}

/* ---- stress and energy
   ------------------------------------------------------------------------------------------- */

/* e_tt, or zero where that is negative, and the inverse of F_tt. */
static void along(const film_stiffness *C, const double *e, direction t, double *strain,
                  double *inverse_F)
{
    const double c2 = t.cosine * t.cosine;
    const double s2 = t.sine * t.sine;
    const double e_tt = c2 * e[0] + s2 * e[1] + t.cosine * t.sine * e[2];
    *strain = e_tt > 0 ? e_tt : 0;
    *inverse_F = 1 / (C->F11 * c2 * c2 + C->F22 * s2 * s2 + (2 * C->F12 + C->F66) * c2 * s2);
}

double wrinkled_density(const film_stiffness *C, const double *e, direction t)
{
    double strain;
    double inverse_F;
    along(C, e, t, &strain, &inverse_F);
    return strain * strain * inverse_F / 2;
}

void wrinkled_stress(const film_stiffness *C, const double *e, direction t, double *S)
{
    double strain;
    double inverse_F;
    along(C, e, t, &strain, &inverse_F);
    const double tension = strain * inverse_F;
    S[0] = tension * t.cosine * t.cosine;
    S[1] = tension * t.sine * t.sine;
    S[2] = tension * t.cosine * t.sine;
}

/* W is the maximum over tau of f = e_tt^2/(2 F_tt): S = df/de, D = d2f/de2 - (d2f/de
   dtau)^2/(d2f/dtau2).  With the tension s = e_tt/F_tt and T = t x t,

       D = T T/F_tt - s v v/g,   v = T' - F'/(2 F) T,   g = e'' + s (F'^2/(4 F) - F''/2) < 0 */
void add_wrinkled(const direction_basis *basis, const double *a, double tau, double weight,
                  double derivative_weight,
                  film_response *sum)
{
    const double strain = value2(a, tau);
    const double inverse_F = 1 / value4(basis->F, tau);
    const double half_slope = slope4(basis->F, tau) / 2 * inverse_F; /* F'/(2 F) */
    const double tension = strain > 0 ? strain * inverse_F : 0;
    const double T[3] = {1, tau * tau, tau};
    const double v[3] = {-half_slope, 2 * tau - half_slope * T[1], 1 - half_slope * tau};
    const double g = 2 * a[2] + strain * half_slope * half_slope - tension * curvature4(basis->F,
                                                                                        tau) / 2;
    const double turning = g < 0 ? -derivative_weight * tension / g : 0;
    const double stretching = derivative_weight * inverse_F;
    int k = 0;
    for (int i = 0; i < 3; i++) {
        sum->S[i] += weight * tension * T[i];
        for (int j = i; j < 3; j++) sum->D[k++] += stretching * T[i] * T[j] + turning * v[i] * v[j];
    }
}

/* The strains p = e1 + e2, q = e1 - e2 and r = 2 e12 turn simply: p stays, (q, r) turns by twice
   the angle. */
void add_from_basis(direction m, const film_response *in_basis, film_response *sum)
{
    const double c = m.cosine * m.cosine - m.sine * m.sine;
    const double s = 2 * m.cosine * m.sine;
    const double *S = in_basis->S;
    const double *D = in_basis->D;
    const double S_p = (S[0] + S[1]) / 2;
    const double S_q = (S[0] - S[1]) / 2;
    const double turned_S_q = c * S_q - s * S[2];
    sum->S[0] += S_p + turned_S_q;
    sum->S[1] += S_p - turned_S_q;
    sum->S[2] += s * S_q + c * S[2];
    const double D_pp = (D[0] + D[3]) / 4 + D[1] / 2;
    const double D_qq = (D[0] + D[3]) / 4 - D[1] / 2;
    const double D_pq = (D[0] - D[3]) / 4;
    const double D_pr = (D[2] + D[4]) / 2;
    const double D_qr = (D[2] - D[4]) / 2;
    const double D_rr = D[5];
    const double turned_pq = c * D_pq - s * D_pr;
    const double turned_pr = s * D_pq + c * D_pr;
    const double turned_qq = c * c * D_qq - 2 * c * s * D_qr + s * s * D_rr;
    const double turned_qr = c * s * (D_qq - D_rr) + (c * c - s * s) * D_qr;
    const double turned_rr = s * s * D_qq + 2 * c * s * D_qr + c * c * D_rr;
    sum->D[0] += D_pp + turned_qq + 2 * turned_pq;
    sum->D[1] += D_pp - turned_qq;
    sum->D[2] += turned_pr + turned_qr;
    sum->D[3] += D_pp + turned_qq - 2 * turned_pq;
    sum->D[4] += turned_pr - turned_qr;
    sum->D[5] += turned_rr;
}

double relaxed_density(const film_stiffness *C, const double *e)
{
    const enum film_state state = film_state_at(C, e);
    if (state == SLACK) return 0;
    if (state == WRINKLED) return wrinkled_density(C, e, tension_direction(C, e));
    double S[3];
    taut_stress(C, e, S);
    return (S[0] * e[0] + S[1] * e[1] + S[2] * e[2]) / 2;
}

void relaxed_response(const film_stiffness *C, const double *e, film_response *response)
{
    memset(response, 0, sizeof *response);
    const enum film_state state = film_state_at(C, e);
    if (state == SLACK) return;
    if (state == TAUT) {
        taut_stress(C, e, response->S);
        add_stiffness(C, 1, response->D);
        return;
    }
    const direction_basis basis = basis_along(C, tension_direction(C, e));
    film_response in_basis = {{0}, {0}};
    double a[3];
    strain_polynomial(&basis, e, a);
    add_wrinkled(&basis, a, 0, 1, 1, &in_basis);
    add_from_basis(basis.m, &in_basis, response);
}
