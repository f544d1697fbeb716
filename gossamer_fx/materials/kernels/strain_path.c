/* Average stress of film that bears no compression along a straight path of strain e0 + s (e1 - e0), 0 <= s <= 1.

   Taut and slack strains are cones, so that the path has at most one interval in each of them, whose ends are roots of
   quadratics.  The average over a taut interval is exact.  In wrinkled intervals the stress is smooth, and Gauss points
   serve, the more the farther the direction of the tension turns. */
#include "relaxed_film.h"

#include <math.h>
#include <string.h>

typedef struct {
    double start, end;
} interval;

/* A path from e0 to e1. */
typedef struct {
    const film_stiffness *C;
    const double *e0, *e1;
    averaged_film *sum;
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

/* Sines of the angle by which the tension turns in an interval up to which 2 and 4 points are tried first. */
static const double SMALL_TURN[RULES - 1] = {1e-3, 3e-2};

/* The energy that an average may miss, over that at both ends: more points, or shorter intervals, are taken beyond. */
static const double TOLERATED_DEFECT = 1e-9;

/* How often an interval may be halved. */
enum { MAX_HALVINGS = 6 };

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

static wrinkled_end end_at(const strain_path *path, double s, const direction *near)
{
    double e[3];
    strain_at(path, s, e);
    wrinkled_end end = {.s = s, .t = tension_direction(path->C, e, near)};
    end.energy = wrinkled_density(path->C, e, end.t);
    return end;
}

static double sine_of_turn(direction a, direction b) { return fabs(a.cosine * b.sine - a.sine * b.cosine); }

/* A direction on the way from one to another, at 0 <= share <= 1; t and -t are the same direction. */
static direction between(direction a, direction b, double share)
{
    const double sign = a.cosine * b.cosine + a.sine * b.sine < 0 ? -1 : 1;
    const double x = (1 - share) * a.cosine + share * sign * b.cosine;
    const double y = (1 - share) * a.sine + share * sign * b.sine;
    const double length = sqrt(x * x + y * y);
    return (direction){x / length, y / length};
}

/* The part of an average that belongs to a wrinkled interval, by a Gauss rule. */
static film_response integral(const strain_path *path, const gauss_rule *rule, wrinkled_end start, wrinkled_end end)
{
    film_response sum = {{0}, {0}};
    const double half = (end.s - start.s) / 2;
    for (int k = 0; k < 2 * rule->half_count; k++) {
        const double x = k % 2 ? -rule->points[k / 2] : rule->points[k / 2];
        const double s = start.s + half * (1 + x);
        const double weight = half * rule->weights[k / 2];
        const direction guess = between(start.t, end.t, (1 + x) / 2);
        double e[3];
        strain_at(path, s, e);
        add_wrinkled(path->C, e, tension_direction(path->C, e, &guess), weight, weight * s, &sum);
    }
    return sum;
}

/* The energy that an average over an interval misses: the stress does not do the work of its change. */
static double defect_of(const strain_path *path, const film_response *average, double change_of_energy)
{
    double work = 0;
    for (int i = 0; i < 3; i++) work += average->S[i] * (path->e1[i] - path->e0[i]);
    return change_of_energy - work;
}

static void add_wrinkled_interval(const strain_path *path, wrinkled_end start, wrinkled_end end, int halvings)
{
    const double turn = sine_of_turn(start.t, end.t);
    int rule = 0;
    while (rule < RULES - 1 && turn > SMALL_TURN[rule]) rule++;
    film_response average;
    double defect;
    for (;; rule++) {
        average = integral(path, &GAUSS[rule], start, end);
        defect = defect_of(path, &average, end.energy - start.energy);
        if (fabs(defect) <= TOLERATED_DEFECT * (start.energy + end.energy)) break;
        if (rule < RULES - 1) continue;
        if (halvings == MAX_HALVINGS) break;
        const direction guess = between(start.t, end.t, 0.5);
        const wrinkled_end middle = end_at(path, (start.s + end.s) / 2, &guess);
        add_wrinkled_interval(path, start, middle, halvings + 1);
        add_wrinkled_interval(path, middle, end, halvings + 1);
        return;
    }
    for (int i = 0; i < 3; i++) path->sum->response.S[i] += average.S[i];
    for (int i = 0; i < 9; i++) path->sum->response.D[i] += average.D[i];
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
    const strain_path path = {C, e0, e1, average};
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
            const wrinkled_end start = end_at(&path, piece.start, NULL);
            add_wrinkled_interval(&path, start, end_at(&path, piece.end, &start.t), 0);
        }
    }
}
