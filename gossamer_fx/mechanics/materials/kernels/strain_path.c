/* Average stress of film that bears no compression along a straight path of strain e0 + s (e1 -
   e0), 0 <= s <= 1.

   Taut and slack strains are cones, so that the path has at most one interval in each of them,
   whose ends are roots of quadratics.  The average over a taut interval is exact.  In wrinkled
   intervals the stress is smooth, and Gauss points serve, the more the farther the direction of the
   tension turns. */
#include "relaxed_film.h"

#include <math.h>
#include <string.h>

#include "polynomials.h"

typedef struct {
    double start, end;
} interval;

/* A path from e0 to e1. */
typedef struct {
    const film_stiffness *C;
    const double *e0, *e1;
    averaged_film *sum;
    double tolerance; /* energy that the average over an interval may miss */
} strain_path;

/* What is known of an end of a wrinkled interval: the direction of the tension, and the energy. */
typedef struct {
    double s;
    direction t;
    double energy;
} wrinkled_end;

/* The Gauss rule on -1 <= x <= 1 with eight points.  Vector instructions evaluate all of them at
   once, which costs less than to find out how many are enough. */
enum { POINTS = 8 };
static const double GAUSS_POINTS[POINTS] = {-0.96028985649753623, -0.79666647741362674, -0.52553240991632899,
                                            -0.18343464249564980, 0.18343464249564980,  0.52553240991632899,
                                            0.79666647741362674,  0.96028985649753623};
static const double GAUSS_WEIGHTS[POINTS] = {0.10122853629037626, 0.22238103445337447, 0.31370664587788729,
                                             0.36268378337836198, 0.36268378337836198, 0.31370664587788729,
                                             0.22238103445337447, 0.10122853629037626};

/* Half the turn of the tension in an interval, as tau, above which its middle is where the tension
   has turned by half. */
static const double TURN_BY_ANGLE = 2e-2;

/* An interval with a larger turn is halved first. */
static const double LARGEST_TURN = 1;

/* The energy that an average may miss, over that at both ends: more points, or shorter intervals,
   are taken beyond. */
static const double TOLERATED_DEFECT = 1e-8;

/* How often an interval may be halved. */
enum { MAX_HALVINGS = 6 };

/* Halley's iterations for the directions at the points of a path, and the step that is the last
   one. */
enum { PATH_ITERATIONS = 4 };
static const double CONVERGED_STEP = 1e-5;

/* a/b limited to [0, 1]. */
static double fraction(double a, double b)
{
    if (!(a * b > 0)) return 0;
    return fabs(a) < fabs(b) ? a / b : 1;
}

static double cone_product(const double *a, const double *b) { return a[0] * b[0] - a[1] * b[1] - a[2] * b[2]; }

/* The part of a straight path that lies in the cone h >= |d| of points (h, d) with three
   components. */
static interval within_cone(const double *first, const double *last)
{
    const double q0 = cone_product(first, first);
    const int starts_inside = first[0] >= 0 && q0 >= 0;
    const int ends_inside = last[0] >= 0 && cone_product(last, last) >= 0;
    if (starts_inside && ends_inside) return (interval){0, 1};
    if (first[0] < 0 && last[0] < 0) return (interval){1, 1};
    double change[3];
    for (int i = 0; i < 3; i++) change[i] = last[i] - first[i];
    /* The quadratic A s^2 + 2 B s + q0 is positive in the cone, and in the opposite one. */
    const double A = cone_product(change, change);
    const double B = cone_product(first, change);
    const double discriminant = B * B - A * q0;
    const int passes_through = A < 0 && discriminant > 0 && first[0] * A < B * change[0];
    if (!starts_inside && !ends_inside && !passes_through) return (interval){1, 1};
    const double root = sqrt(discriminant > 0 ? discriminant : 0);
    /* Of the two forms of each root the one whose terms have the same sign. */
    double entry = B < 0 ? fraction(root - B, A) : fraction(-q0, B + root);
    double exit = B < 0 ? fraction(q0, root - B) : fraction(-B - root, A);
    /* The cone ends where h = 0; a path along the border of the opposite cone has its roots in
       there. */
    const double apex = fraction(first[0], first[0] - last[0]);
    if (first[0] < 0 && entry < apex) entry = apex;
    if (last[0] < 0 && exit > apex) exit = apex;
    if (starts_inside) entry = 0;
    if (ends_inside) exit = 1;
    return (interval){entry, exit > entry ? exit : entry};
}

static interval taut_interval(const film_stiffness *C, const double *e0, const double *e1)
{
    double S[3];
    double ends[2][3];
    for (int k = 0; k < 2; k++) {
        taut_stress(C, k ? e1 : e0, S);
        ends[k][0] = (S[0] + S[1]) / 2 + C->margin;
        ends[k][1] = (S[0] - S[1]) / 2;
        ends[k][2] = S[2];
    }
    return within_cone(ends[0], ends[1]);
}

static interval slack_interval(const double *e0, const double *e1)
{
    double ends[2][3];
    for (int k = 0; k < 2; k++) {
        const double *e = k ? e1 : e0;
        ends[k][0] = -(e[0] + e[1]) / 2;
        ends[k][1] = (e[0] - e[1]) / 2;
        ends[k][2] = e[2] / 2;
    }
    return within_cone(ends[0], ends[1]);
}

static void strain_at(const strain_path *path, double s, double *e)
{
    for (int i = 0; i < 3; i++) e[i] = path->e0[i] + s * (path->e1[i] - path->e0[i]);
}

/* A point of the path; the direction of the tension is near a known one, unless that is NULL. */
static wrinkled_end end_at(const strain_path *path, double s, const direction *near)
{
    double e[3];
    strain_at(path, s, e);
    wrinkled_end end = {.s = s};
    end.t = near == NULL ? tension_direction(path->C, e) : tension_direction_near(path->C, e,
                                                                                  *near);
    end.energy = wrinkled_density(path->C, e, end.t);
    return end;
}

/* Where the path leaves or enters the taut strains: the taut stress is a tension there. */
static wrinkled_end taut_border(const strain_path *path, double s)
{
    double e[3];
    double S[3];
    strain_at(path, s, e);
    taut_stress(path->C, e, S);
    const double x = S[0] > S[1] ? S[0] : S[2];
    const double y = S[0] > S[1] ? S[2] : S[1];
    const double length = sqrt(x * x + y * y);
    if (!(length > 0)) return end_at(path, s, NULL);
    wrinkled_end end = {.s = s, .t = {x / length, y / length}};
    end.energy = wrinkled_density(path->C, e, end.t);
    return end;
}

/* Where the path leaves or enters the slack strains: the largest strain is zero there. */
static wrinkled_end slack_border(const strain_path *path, double s)
{
    double e[3];
    strain_at(path, s, e);
    return (wrinkled_end){s, direction_of_largest_strain(e), 0};
}

static wrinkled_end border(const strain_path *path, double s, interval taut)
{
    return s == taut.start || s == taut.end ? taut_border(path, s) : slack_border(path, s);
}

/* Both ends of a wrinkled interval.  At borders the direction is known; those of the path begin
   from the other end. */
static void find_ends(const strain_path *path, interval of, interval taut, wrinkled_end *start,
                      wrinkled_end *end)
{
    const int ends_at_border = of.end < 1;
    if (ends_at_border) *end = border(path, of.end, taut);
    *start = of.start > 0 ? border(path, of.start, taut) : end_at(path, 0,
                                                                  ends_at_border ? &end->t : NULL);
    if (!ends_at_border) *end = end_at(path, 1, &start->t);
}

/* A wrinkled interval in the basis of its mean direction, from which the tension turns by -turn to
   turn. */
typedef struct {
    double start, end; /* s */
    double turn;       /* tau at the end */
    direction_basis basis;
    double a0[3], change[3];       /* polynomials of e0 and of e1 - e0 */
    double P0[5], P_change[5]; /* slopes of them */
} wrinkled_interval;

/* An interval whose tension turns from a to b, by less than a right angle from their mean; t and -t
   are the same direction, so that there are two ways. */
static wrinkled_interval interval_from(const strain_path *path, const wrinkled_end *start,
                                       const wrinkled_end *end,
                                       double sign)
{
    const direction b = {sign * end->t.cosine, sign * end->t.sine};
    const double x = start->t.cosine + b.cosine;
    const double y = start->t.sine + b.sine;
    const double length = sqrt(x * x + y * y);
    const direction m = {x / length, y / length};
    wrinkled_interval of = {.start = start->s, .end = end->s, .basis = basis_along(path->C, m)};
    of.turn = (m.cosine * b.sine - m.sine * b.cosine) / (m.cosine * b.cosine + m.sine * b.sine);
    double change[3];
    for (int i = 0; i < 3; i++) change[i] = path->e1[i] - path->e0[i];
    strain_polynomial(&of.basis, path->e0, of.a0);
    strain_polynomial(&of.basis, change, of.change);
    slope_polynomial(&of.basis, of.a0, of.P0);
    slope_polynomial(&of.basis, of.change, of.P_change);
    return of;
}

static wrinkled_interval interval_between(const strain_path *path, const wrinkled_end *start,
                                          const wrinkled_end *end)
{
    const double cosine = start->t.cosine * end->t.cosine + start->t.sine * end->t.sine;
    const double sign = cosine < 0 ? -1 : 1;
    const wrinkled_interval of = interval_from(path, start, end, sign);
    /* The tension turns towards growing tau where P_change > 0. */
    const int is_this_way = value4(of.P_change, -of.turn) * of.turn > 0;
    return is_this_way || fabs(of.turn) < TURN_BY_ANGLE ? of : interval_from(path, start, end,
                                                                             -sign);
}

/* Directions tau (POINTS) of the tension at the points s (POINTS) of the path, from guesses.
   Returns whether all of them are found. */
static int find_directions(const wrinkled_interval *of, const double *s, double *tau)
{
    double P[5][POINTS];
    for (int i = 0; i < 5; i++)
        for (int k = 0; k < POINTS; k++) P[i][k] = of->P0[i] + s[k] * of->P_change[i];
    int is_found = 0;
    for (int iteration = 0; iteration < PATH_ITERATIONS && !is_found; iteration++) {
        double steps[POINTS];
        for (int k = 0; k < POINTS; k++) {
            const double at_point[5] = {P[0][k], P[1][k], P[2][k], P[3][k], P[4][k]};
            steps[k] = halley_step(value4(at_point, tau[k]), slope4(at_point, tau[k]),
                                   curvature4(at_point, tau[k]));
            tau[k] -= steps[k];
        }
        is_found = 1;
        for (int k = 0; k < POINTS; k++) is_found &= fabs(steps[k]) <= CONVERGED_STEP;
    }
    return is_found;
}

/* The same one by one, without guesses. */
static void search_directions(const strain_path *path, const wrinkled_interval *of, const double *s,
                              double *tau)
{
    const direction m = of->basis.m;
    for (int k = 0; k < POINTS; k++) {
        const direction t = end_at(path, s[k], NULL).t;
        tau[k] = (m.cosine * t.sine - m.sine * t.cosine) / (m.cosine * t.cosine + m.sine * t.sine);
    }
}

static double sum_of(const double *values)
{
    return ((values[0] + values[4]) + (values[2] + values[6])) + ((values[1] + values[5]) + (values[3] + values[7]));
}

/* Add the responses at the points s (POINTS) of the path, with their weights: `add_wrinkled` for
   all points at once. */
static void add_points(const wrinkled_interval *of, const double *s, const double *tau,
                       const double *weights,
                       film_response *sum)
{
    double terms[9][POINTS];
    for (int k = 0; k < POINTS; k++) {
        const double x = tau[k];
        double a[3];
        for (int i = 0; i < 3; i++) a[i] = of->a0[i] + s[k] * of->change[i];
        const double strain = value2(a, x);
        const double inverse_F = 1 / value4(of->basis.F, x);
        const double half_slope = slope4(of->basis.F, x) / 2 * inverse_F;
        const double tension = strain > 0 ? strain * inverse_F : 0;
        const double v0 = -half_slope;
        const double v1 = x * (2 + x * v0);
        const double v2 = 1 + x * v0;
        const double g = 2 * a[2] + strain * half_slope * half_slope - tension * curvature4(of->basis.F, x) / 2;
        const double derivative_weight = weights[k] * s[k];
        const double turning = g < 0 ? -derivative_weight * tension / g : 0;
        const double stretching = derivative_weight * inverse_F;
        const double square = x * x;
        terms[0][k] = weights[k] * tension;
        terms[1][k] = weights[k] * tension * square;
        terms[2][k] = weights[k] * tension * x;
        terms[3][k] = stretching + turning * v0 * v0;
        terms[4][k] = stretching * square + turning * v0 * v1;
        terms[5][k] = stretching * x + turning * v0 * v2;
        terms[6][k] = stretching * square * square + turning * v1 * v1;
        terms[7][k] = stretching * square * x + turning * v1 * v2;
        terms[8][k] = stretching * square + turning * v2 * v2;
    }
    for (int i = 0; i < 3; i++) sum->S[i] += sum_of(terms[i]);
    for (int i = 0; i < 6; i++) sum->D[i] += sum_of(terms[3 + i]);
}

/* The part of an average that belongs to a wrinkled interval, in its basis. */
static film_response integral_over(const strain_path *path, const wrinkled_interval *of)
{
    const double half = (of->end - of->start) / 2;
    double s[POINTS];
    double tau[POINTS];
    double weights[POINTS];
    for (int k = 0; k < POINTS; k++) {
        s[k] = of->start + half * (1 + GAUSS_POINTS[k]);
        tau[k] = of->turn * GAUSS_POINTS[k];
        weights[k] = half * GAUSS_WEIGHTS[k];
    }
    if (!find_directions(of, s, tau)) search_directions(path, of, s, tau);
    film_response sum = {{0}, {0}};
    add_points(of, s, tau, weights, &sum);
    return sum;
}

/* A point inside an interval: where the tension has turned by half, or the middle of the path. */
static wrinkled_end middle_of(const strain_path *path, const wrinkled_interval *of)
{
    const double s = -of->P0[0] / of->P_change[0];
    if (!(fabs(of->turn) > TURN_BY_ANGLE && s > of->start && s < of->end))
        return end_at(path, (of->start + of->end) / 2, &of->basis.m);
    double e[3];
    strain_at(path, s, e);
    return (wrinkled_end){s, of->basis.m, wrinkled_density(path->C, e, of->basis.m)};
}

static void add_wrinkled_interval(const strain_path *path, wrinkled_end start, wrinkled_end end,
                                  int halvings)
{
    const wrinkled_interval of = interval_between(path, &start, &end);
    /* Changes of e_mm, e_nn and 2 e_mn, on which the stress of the basis does its work. */
    const double strains[3] = {of.change[0], of.change[2], of.change[1]};
    film_response average;
    double defect = 0;
    int is_accurate = 0;
    if (fabs(of.turn) <= LARGEST_TURN || halvings == MAX_HALVINGS) {
        average = integral_over(path, &of);
        defect = end.energy - start.energy;
        for (int i = 0; i < 3; i++) defect -= average.S[i] * strains[i];
        is_accurate = fabs(defect) <= path->tolerance;
    }
    if (!is_accurate && halvings < MAX_HALVINGS) {
        const wrinkled_end middle = middle_of(path, &of);
        add_wrinkled_interval(path, start, middle, halvings + 1);
        add_wrinkled_interval(path, middle, end, halvings + 1);
        return;
    }
    add_from_basis(of.basis.m, &average, &path->sum->response);
    path->sum->missing += defect;
    path->sum->energy += start.energy + end.energy;
}

static void add_taut_interval(const strain_path *path, interval of)
{
    double e[3];
    double S[3];
    strain_at(path, (of.start + of.end) / 2, e);
    taut_stress(path->C, e, S);
    for (int i = 0; i < 3; i++) path->sum->response.S[i] += (of.end - of.start) * S[i];
    add_stiffness(path->C, (of.end * of.end - of.start * of.start) / 2, path->sum->response.D);
}

static void sort(double *numbers, int count)
{
    for (int i = 1; i < count; i++)
        for (int j = i; j > 0 && numbers[j] < numbers[j - 1]; j--) {
            const double swapped = numbers[j];
            numbers[j] = numbers[j - 1];
            numbers[j - 1] = swapped;
        }
}

static int contains(interval of, double s) { return of.start < s && s < of.end; }

void averaged_response(const film_stiffness *C, const double *e0, const double *e1,
                       averaged_film *average)
{
    memset(average, 0, sizeof *average);
    strain_path path = {C, e0, e1, average, 0};
    const interval taut = taut_interval(C, e0, e1);
    const interval slack = slack_interval(e0, e1);
    double cuts[6] = {0, taut.start, taut.end, slack.start, slack.end, 1};
    sort(cuts, 6);
    for (int k = 0; k < 5; k++) {
        const interval piece = {cuts[k], cuts[k + 1]};
        if (piece.end <= piece.start) continue;
        const double middle = (piece.start + piece.end) / 2;
        if (contains(taut, middle)) {
            add_taut_interval(&path, piece);
            if (piece.end == 1) taut_stress(C, e1, average->end_stress);
        } else if (!contains(slack, middle)) {
            wrinkled_end start;
            wrinkled_end end;
            find_ends(&path, piece, taut, &start, &end);
            path.tolerance = TOLERATED_DEFECT * (start.energy + end.energy);
            add_wrinkled_interval(&path, start, end, 0);
            if (piece.end == 1) wrinkled_stress(C, e1, end.t, average->end_stress);
        }
    }
}
