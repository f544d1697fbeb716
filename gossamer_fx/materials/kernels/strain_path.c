/* Average stress of film that bears no compression along a straight path of strain e0 + s (e1 - e0), 0 <= s <= 1.

   Taut and slack strains are cones, so that the path has at most one interval in each of them, whose ends are roots of
   quadratics.  The average over a taut interval is exact.  In wrinkled intervals the stress is smooth, and Gauss points
   serve, the more the farther the direction of the tension turns. */
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

/* A Gauss rule on -1 <= x <= 1: points x > 0 and their weights; those at -x have the same weights. */
typedef struct {
    int half_count;
    double points[4];
    double weights[4];
} gauss_rule;

enum { RULES = 3 };
static const gauss_rule GAUSS[RULES] = {
    {1, {0.57735026918962576}, {1}},
    {2, {0.33998104358485626, 0.86113631159405258}, {0.65214515486254614, 0.34785484513745386}},
    {4,
     {0.18343464249564980, 0.52553240991632899, 0.79666647741362674, 0.96028985649753623},
     {0.36268378337836198, 0.31370664587788729, 0.22238103445337447, 0.10122853629037626}}};

/* Half the turn of the tension in an interval, as tau, up to which 2 and 4 points are tried first. */
static const double SMALL_TURN[RULES - 1] = {2e-3, 0.1};

/* Below this turn points are chosen along the path, above it by the angle of the tension. */
static const double TURN_BY_ANGLE = 2e-2;

/* An interval with a larger turn is halved first. */
static const double LARGEST_TURN = 1;

/* The energy that an average may miss, over that at both ends: more points, or shorter intervals, are taken beyond. */
static const double TOLERATED_DEFECT = 1e-8;

/* How often an interval may be halved. */
enum { MAX_HALVINGS = 6 };

/* Newton's iterations for the direction at a point of a path, and the step that is the last one. */
enum { PATH_ITERATIONS = 4 };
static const double CONVERGED_STEP = 1e-8;

/* a/b limited to [0, 1]. */
static double fraction(double a, double b)
{
    if (!(a * b > 0)) return 0;
    return fabs(a) < fabs(b) ? a / b : 1;
}

static double cone_product(const double *a, const double *b) { return a[0] * b[0] - a[1] * b[1] - a[2] * b[2]; }

/* The part of a straight path that lies in the cone h >= |d| of points (h, d) with three components. */
static interval within_cone(const double *first, const double *last)
{
    double change[3];
    for (int i = 0; i < 3; i++) change[i] = last[i] - first[i];
    /* The quadratic A s^2 + 2 B s + q0 is positive in the cone, and in the opposite one. */
    const double A = cone_product(change, change);
    const double B = cone_product(first, change);
    const double q0 = cone_product(first, first);
    const int starts_inside = first[0] >= 0 && q0 >= 0;
    const int ends_inside = last[0] >= 0 && cone_product(last, last) >= 0;
    if (starts_inside && ends_inside) return (interval){0, 1};
    const double discriminant = B * B - A * q0;
    const int passes_through = A < 0 && discriminant > 0 && first[0] * A < B * change[0];
    if (!starts_inside && !ends_inside && !passes_through) return (interval){1, 1};
    const double root = sqrt(discriminant > 0 ? discriminant : 0);
    /* Of the two forms of each root the one whose terms have the same sign. */
    double entry = B < 0 ? fraction(root - B, A) : fraction(-q0, B + root);
    double exit = B < 0 ? fraction(q0, root - B) : fraction(-B - root, A);
    /* The cone ends where h = 0; a path along the border of the opposite cone has its roots in there. */
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

static wrinkled_end end_at(const strain_path *path, double s)
{
    double e[3];
    strain_at(path, s, e);
    wrinkled_end end = {.s = s, .t = tension_direction(path->C, e)};
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
    if (!(length > 0)) return end_at(path, s);
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

static wrinkled_end interval_end(const strain_path *path, double s, interval taut)
{
    if (s > 0 && s < 1) return s == taut.start || s == taut.end ? taut_border(path, s) : slack_border(path, s);
    return end_at(path, s);
}

/* A wrinkled interval in the basis of its mean direction, from which the tension turns by -turn to turn. */
typedef struct {
    double start, end; /* s */
    double turn;       /* tau at the end */
    direction_basis basis;
    double a0[3], change[3];       /* polynomials of e0 and of e1 - e0 */
    double P0[5], P_change[5]; /* slopes of them */
} wrinkled_interval;

/* An interval whose tension turns from a to b, by less than a right angle from their mean; t and -t are the same
   direction, so that there are two ways. */
static wrinkled_interval interval_from(const strain_path *path, const wrinkled_end *start, const wrinkled_end *end,
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

static wrinkled_interval interval_between(const strain_path *path, const wrinkled_end *start, const wrinkled_end *end)
{
    const double cosine = start->t.cosine * end->t.cosine + start->t.sine * end->t.sine;
    const double sign = cosine < 0 ? -1 : 1;
    const wrinkled_interval of = interval_from(path, start, end, sign);
    /* The tension turns towards growing tau where P_change > 0. */
    const int is_this_way = value4(of.P_change, -of.turn) * of.turn > 0;
    return is_this_way || fabs(of.turn) < TURN_BY_ANGLE ? of : interval_from(path, start, end, -sign);
}

/* Add the response at a point s of the path, where the tension has the direction tau. */
static void add_point(const wrinkled_interval *of, double s, double tau, double weight, film_response *sum)
{
    double a[3];
    for (int i = 0; i < 3; i++) a[i] = of->a0[i] + s * of->change[i];
    add_wrinkled(&of->basis, a, tau, weight, weight * s, sum);
}

/* A Gauss point of the path: its direction is the root of P0 + s P_change, of which a guess is near. */
static void add_point_of_path(const strain_path *path, const wrinkled_interval *of, double x, double weight,
                              film_response *sum)
{
    const double half = (of->end - of->start) / 2;
    const double s = of->start + half * (1 + x);
    double P[5];
    for (int i = 0; i < 5; i++) P[i] = of->P0[i] + s * of->P_change[i];
    double tau = x * of->turn;
    double step = 1;
    for (int i = 0; i < PATH_ITERATIONS && fabs(step) > CONVERGED_STEP; i++) {
        step = value4(P, tau) / slope4(P, tau);
        tau -= step;
    }
    if (!(fabs(step) <= CONVERGED_STEP)) {
        const direction t = end_at(path, s).t;
        const direction m = of->basis.m;
        tau = (m.cosine * t.sine - m.sine * t.cosine) / (m.cosine * t.cosine + m.sine * t.sine);
    }
    add_point(of, s, tau, weight * half, sum);
}

/* A Gauss point of the angle: P0 + s P_change = 0 says where on the path the tension has this direction.  Returns 0 if
   that is not in the interval: then the tension turns the other way, by more than a right angle. */
static int add_point_of_angle(const wrinkled_interval *of, double x, double weight, film_response *sum)
{
    const double tau = x * of->turn;
    const double inverse = 1 / value4(of->P_change, tau);
    const double s = -value4(of->P0, tau) * inverse;
    const double slope = -(slope4(of->P0, tau) + s * slope4(of->P_change, tau)) * inverse; /* ds/dtau */
    if (!(s >= of->start && s <= of->end && slope * of->turn > 0)) return 0;
    add_point(of, s, tau, weight * of->turn * slope, sum);
    return 1;
}

/* The part of an average that belongs to a wrinkled interval, by a Gauss rule; in its basis.  Returns 0 if the rule
   fails. */
static int integrate(const strain_path *path, const wrinkled_interval *of, const gauss_rule *rule, int by_angle,
                     film_response *sum)
{
    memset(sum, 0, sizeof *sum);
    for (int k = 0; k < 2 * rule->half_count; k++) {
        const double x = k % 2 ? -rule->points[k / 2] : rule->points[k / 2];
        if (!by_angle)
            add_point_of_path(path, of, x, rule->weights[k / 2], sum);
        else if (!add_point_of_angle(of, x, rule->weights[k / 2], sum))
            return 0;
    }
    return 1;
}

/* A point inside an interval: where the tension has turned by half, or the middle of the path. */
static wrinkled_end middle_of(const strain_path *path, const wrinkled_interval *of)
{
    const double s = -of->P0[0] / of->P_change[0];
    if (!(fabs(of->turn) > TURN_BY_ANGLE && s > of->start && s < of->end))
        return end_at(path, (of->start + of->end) / 2);
    double e[3];
    strain_at(path, s, e);
    return (wrinkled_end){s, of->basis.m, wrinkled_density(path->C, e, of->basis.m)};
}

static void add_wrinkled_interval(const strain_path *path, wrinkled_end start, wrinkled_end end, int halvings)
{
    const wrinkled_interval of = interval_between(path, &start, &end);
    /* Changes of e_mm, e_nn and 2 e_mn, on which the stress of the basis does its work. */
    const double strains[3] = {of.change[0], of.change[2], of.change[1]};
    const int by_angle = fabs(of.turn) > TURN_BY_ANGLE && halvings < MAX_HALVINGS;
    film_response average;
    double defect = 0;
    int is_accurate = 0;
    int rule = 0;
    while (rule < RULES - 1 && fabs(of.turn) > SMALL_TURN[rule]) rule++;
    if (fabs(of.turn) > LARGEST_TURN && halvings < MAX_HALVINGS) rule = RULES;
    for (; rule < RULES && !is_accurate; rule++) {
        if (!integrate(path, &of, &GAUSS[rule], by_angle, &average)) break;
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

void averaged_response(const film_stiffness *C, const double *e0, const double *e1, averaged_film *average)
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
        } else if (!contains(slack, middle)) {
            const wrinkled_end start = interval_end(&path, piece.start, taut);
            const wrinkled_end end = interval_end(&path, piece.end, taut);
            path.tolerance = TOLERATED_DEFECT * (start.energy + end.energy);
            add_wrinkled_interval(&path, start, end, 0);
        }
    }
}
