/* Energy, force and tangent of contact pairs: pairs.py has the equations.

   A pair has four points.  Kinds: 0 point-triangle, 1 edge-edge; 2 point and plane (point, origin, normal),
   3 point in a sphere (point, centre), 4 point in a cylinder (point, origin, two directions across the axis). */
#include <float.h>
#include <math.h>
#include <stdint.h>
#include <string.h>

enum { POINT_TRIANGLE, EDGE_EDGE, PLANE, IN_SPHERE, IN_CYLINDER };
enum { BARRIER, PENALTY };

static const double ROWS[5][3][4] = {
    {{1, -1, 0, 0}, {0, 1, -1, 0}, {0, 1, 0, -1}},
    {{1, 0, -1, 0}, {-1, 1, 0, 0}, {0, 0, 1, -1}},
    {{1, -1, 0, 0}, {0, 0, 1, 0}, {0, 0, 0, 0}},
    {{1, -1, 0, 0}, {0, 0, 0, 0}, {0, 0, 0, 0}},
    {{1, -1, 0, 0}, {0, 0, 1, 0}, {0, 0, 0, 1}},
};
static const int I[6] = {0, 0, 0, 1, 1, 2}, J[6] = {0, 1, 2, 1, 2, 2};
static const double LOW = 0.02; /* part of x that rounded edges must keep in a step */
static const double GAUSS[2] = {0.21132486540518713, 0.7886751345948129};

static double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static void cross(const double *a, const double *b, double *c)
{
    c[0] = a[1] * b[2] - a[2] * b[1];
    c[1] = a[2] * b[0] - a[0] * b[2];
    c[2] = a[0] * b[1] - a[1] * b[0];
}

static double triple(double Y[3][3])
{
    double c[3];
    cross(Y[1], Y[2], c);
    return dot(Y[0], c);
}

static void vectors(const double R[3][4], const double *x, const int32_t *p, double Y[3][3])
{
    for (int i = 0; i < 3; ++i)
        for (int c = 0; c < 3; ++c) {
            double sum = 0;
            for (int k = 0; k < 4; ++k)
                if (R[i][k] != 0) sum += R[i][k] * x[3 * p[k] + c];
            Y[i][c] = sum;
        }
}

static void gram(double Y[3][3], double e[6])
{
    for (int m = 0; m < 6; ++m) e[m] = dot(Y[I[m]], Y[J[m]]);
}

/* ---- the nearest points of a pair ------------------------------------------------------------------------------- */

typedef struct {
    double u, v;          /* where they are */
    double z[2], F1;      /* a direction in which (u, v) is free, and the curvature along it; F1 = 0: none */
    double shear, F2;     /* interior: the second direction (-shear, 1) and its curvature; F2 = 0: none */
} Nearest;

static double clip(double t) { return t > 0 ? (t < 1 ? t : 1) : 0; }

/* Minimum of rr + 2u ra + 2v rb + u² aa + 2uv ab + v² bb over the triangle or square with the corner (U, V). */
static Nearest nearest(int edges, const double e[6], double U, double V)
{
    const double ra = e[1], rb = e[2], aa = e[3], ab = e[4], bb = e[5], det = aa * bb - ab * ab;
    Nearest n = {0, 0, {0, 0}, 0, 0, 0};
    if (det > 1e-14 * aa * bb) {
        const double u = (ab * rb - bb * ra) / det, v = (ab * ra - aa * rb) / det, s = u - U, t = v - V;
        if (s >= 0 && t >= 0 && (edges ? s <= 1 && t <= 1 : s + t <= 1)) {
            n.u = u, n.v = v, n.z[0] = 1, n.F1 = 2 * aa, n.shear = ab / aa, n.F2 = 2 * det / aa;
            return n;
        }
    }
    double best = INFINITY;
    for (int side = 0; side < 5; ++side) {
        if (edges ? side == 4 : side == 2 || side == 3) continue;
        double u = U, v = V, z[2] = {0, 1};
        if (side == 1 || side == 3) z[0] = 1, z[1] = 0;
        if (side == 2) u += 1;
        if (side == 3) v += 1;
        if (side == 4) v += 1, z[0] = 1, z[1] = -1;
        const double F = z[0] * z[0] * aa + 2 * z[0] * z[1] * ab + z[1] * z[1] * bb;
        const double g = z[0] * (ra + u * aa + v * ab) + z[1] * (rb + u * ab + v * bb);
        const double t = F > 0 ? clip(-g / F) : 0;
        u += t * z[0], v += t * z[1];
        const double value = u * (2 * ra + u * aa + 2 * v * ab) + v * (2 * rb + v * bb);
        if (value < best) {
            best = value, n.u = u, n.v = v, n.z[0] = z[0], n.z[1] = z[1];
            n.F1 = t > 0 && t < 1 ? 2 * F : 0;
        }
    }
    return n;
}

/* The same from the vectors: thin triangles and almost parallel edges keep their digits. */
static void nearest_points(int edges, double Y[3][3], double *u, double *v)
{
    double e[6], n[3], c[3];
    gram(Y, e);
    cross(Y[1], Y[2], n);
    const double det = dot(n, n);
    double best = INFINITY;
    if (det > 1e-24 * e[3] * e[5]) {
        cross(Y[0], Y[2], c);
        const double s = -dot(c, n) / det;
        cross(Y[1], Y[0], c);
        const double t = -dot(c, n) / det;
        if (s >= 0 && t >= 0 && (edges ? s <= 1 && t <= 1 : s + t <= 1)) {
            double w[3];
            for (int k = 0; k < 3; ++k) w[k] = Y[0][k] + s * Y[1][k] + t * Y[2][k];
            *u = s, *v = t, best = dot(w, w);
            if (det > 1e-14 * e[3] * e[5]) return;
        }
    }
    /* the sides; if the vectors are almost parallel, their best is compared with the interior one */
    const double corner[5][4] = {{0, 0, 0, 1}, {0, 0, 1, 0}, {1, 0, 0, 1}, {0, 1, 1, 0}, {0, 1, 1, -1}};
    for (int side = 0; side < 5; ++side) {
        if (edges ? side == 4 : side == 2 || side == 3) continue;
        const double *g = corner[side];
        double w[3], d[3];
        for (int k = 0; k < 3; ++k) {
            w[k] = Y[0][k] + g[0] * Y[1][k] + g[1] * Y[2][k];
            d[k] = g[2] * Y[1][k] + g[3] * Y[2][k];
        }
        const double F = dot(d, d), t = F > 0 ? clip(-dot(w, d) / F) : 0;
        for (int k = 0; k < 3; ++k) w[k] += t * d[k];
        const double value = dot(w, w);
        if (value < best) best = value, *u = g[0] + t * g[2], *v = g[1] + t * g[3];
    }
}

static double squared(double Y[3][3], double u, double v)
{
    double w[3];
    for (int k = 0; k < 3; ++k) w[k] = Y[0][k] + u * Y[1][k] + v * Y[2][k];
    return dot(w, w);
}

static double distance2(int kind, const double *x, const int32_t *p)
{
    double Y[3][3], u, v;
    vectors(ROWS[kind], x, p, Y);
    nearest_points(kind == EDGE_EDGE, Y, &u, &v);
    return squared(Y, u, v);
}

void squared_distances(int n, const int32_t *pairs, const uint8_t *kind, const double *x, double *s, double *uv)
{
    for (int i = 0; i < n; ++i) {
        double Y[3][3];
        const int k = kind[i];
        vectors(ROWS[k], x, pairs + 4 * i, Y);
        double u = 0, v = 0;
        if (k <= EDGE_EDGE) {
            nearest_points(k == EDGE_EDGE, Y, &u, &v);
            s[i] = squared(Y, u, v);
        } else if (k == PLANE)
            s[i] = dot(Y[0], Y[1]);
        else if (k == IN_SPHERE)
            s[i] = -dot(Y[0], Y[0]);
        else
            s[i] = -dot(Y[0], Y[1]) * dot(Y[0], Y[1]) - dot(Y[0], Y[2]) * dot(Y[0], Y[2]);
        if (uv) uv[2 * i] = u, uv[2 * i + 1] = v;
    }
}

/* ---- energies of unit stiffness: b(x), its secant slope and that one's derivative by the end ---------------------- */

static double energy_of(int law, int linear, double x)
{
    if (x >= 1) return 0;
    if (law == BARRIER) return x > 0 ? (1 - x) * (1 - x) * (1 - x) / (4 * x) : NAN;
    const double d = linear ? x : sqrt(x > 0 ? x : 0);
    return (1 - d) * (1 - d) / 2;
}

static double slope_of(int law, int linear, double x)
{
    if (x >= 1) return 0;
    if (law == BARRIER) return x > 0 ? (3 - 2 * x - 1 / (x * x)) / 4 : NAN;
    if (linear) return x - 1;
    const double d = sqrt(x > 1e-30 ? x : 1e-30);
    return -(1 - d) / (2 * d);
}

static double curvature_of(int law, int linear, double x)
{
    if (x >= 1) return 0;
    if (law == BARRIER) return (1 / (x * x * x) - 1) / 2;
    if (linear) return 1;
    const double d = sqrt(x > 1e-30 ? x : 1e-30);
    return 1 / (4 * d * d * d);
}

static void secant(int law, int linear, double x0, double x1, double *slope, double *rise)
{
    if (x0 < 1 && x1 < 1) { /* closed forms: no difference of nearly equal numbers */
        if (law == BARRIER) {
            *slope = x1 > 0 ? (3 - x0 - x1 - 1 / (x0 * x1)) / 4 : NAN;
            *rise = (1 / (x0 * x1 * x1) - 1) / 4;
        } else if (linear) {
            *slope = (x0 + x1) / 2 - 1;
            *rise = 0.5;
        } else {
            const double d0 = sqrt(x0 > 0 ? x0 : 0), d1 = sqrt(x1 > 1e-30 ? x1 : 1e-30);
            *slope = 0.5 - 1 / (d0 + d1);
            *rise = 1 / ((d0 + d1) * (d0 + d1) * 2 * d1);
        }
        return;
    }
    const double Δ = x1 - x0;
    *slope = (energy_of(law, linear, x1) - energy_of(law, linear, x0)) / Δ;
    *rise = (slope_of(law, linear, x1) - *slope) / Δ;
}

/* ---- one pair ----------------------------------------------------------------------------------------------------- */

typedef struct {
    double R[3][4]; /* the vectors r, a, b of the points; r leads to the nearest points at the start */
    double U, V, w; /* corner of the domain of (u, v), and ε */
    int kind;
} Pair;

static Pair begin(int kind, double rounding)
{
    Pair P = {.U = 0, .V = 0, .w = kind == EDGE_EDGE ? rounding : 0, .kind = kind};
    memcpy(P.R, ROWS[kind], sizeof P.R);
    return P;
}

/* Let r lead to the point (u, v), also in the vectors Y. */
static void shift(Pair *P, double u, double v, double Y[3][3])
{
    for (int j = 0; j < 4; ++j) P->R[0][j] += u * P->R[1][j] + v * P->R[2][j];
    for (int c = 0; c < 3; ++c) Y[0][c] += u * Y[1][c] + v * Y[2][c];
    P->U = -u, P->V = -v;
}

static void add_rounding(const Pair *P, double e[6])
{
    if (P->w == 0) return;
    const double u = -P->U - 0.5, v = -P->V - 0.5;
    e[0] += P->w * (u * u + v * v), e[1] += P->w * u, e[2] += P->w * v, e[3] += P->w, e[5] += P->w;
}

/* s of the vectors Y, and φ = ds/de. */
static double value(const Pair *P, double Y[3][3], double φ[6])
{
    memset(φ, 0, 6 * sizeof *φ);
    if (P->kind == PLANE) return φ[1] = 1, dot(Y[0], Y[1]);
    if (P->kind == IN_SPHERE) return φ[0] = -1, -dot(Y[0], Y[0]);
    if (P->kind == IN_CYLINDER) {
        const double a = dot(Y[0], Y[1]), b = dot(Y[0], Y[2]);
        φ[1] = -2 * a, φ[2] = -2 * b;
        return -a * a - b * b;
    }
    double e[6];
    gram(Y, e);
    add_rounding(P, e);
    const Nearest n = nearest(P->kind == EDGE_EDGE, e, P->U, P->V);
    const double u = n.u - P->U - 0.5, v = n.v - P->V - 0.5;
    φ[0] = 1, φ[1] = 2 * n.u, φ[2] = 2 * n.v, φ[3] = n.u * n.u, φ[4] = 2 * n.u * n.v, φ[5] = n.v * n.v;
    return squared(Y, n.u, n.v) + P->w * (u * u + v * v);
}

/* φ of measures e, and H -= weight d²s/de² of the pair, if it is not null. */
static void weights(const Pair *P, const double e_[6], double φ[6], double (*H)[6], double weight)
{
    memset(φ, 0, 6 * sizeof *φ);
    if (P->kind == PLANE) {
        φ[1] = 1;
        return;
    }
    if (P->kind == IN_SPHERE) {
        φ[0] = -1;
        return;
    }
    if (P->kind == IN_CYLINDER) {
        φ[1] = -2 * e_[1], φ[2] = -2 * e_[2];
        if (H) H[1][1] -= 2 * weight, H[2][2] -= 2 * weight;
        return;
    }
    double e[6];
    memcpy(e, e_, sizeof e);
    add_rounding(P, e);
    const Nearest n = nearest(P->kind == EDGE_EDGE, e, P->U, P->V);
    const double u = n.u, v = n.v;
    φ[0] = 1, φ[1] = 2 * u, φ[2] = 2 * v, φ[3] = u * u, φ[4] = 2 * u * v, φ[5] = v * v;
    if (!H || n.F1 <= 0) return;
    const double Ju[6] = {0, 2, 0, 2 * u, 2 * v, 0}, Jv[6] = {0, 0, 2, 0, 2 * u, 2 * v};
    double q[6];
    for (int m = 0; m < 6; ++m) q[m] = n.z[0] * Ju[m] + n.z[1] * Jv[m];
    for (int m = 0; m < 6; ++m)
        for (int k = 0; k < 6; ++k) H[m][k] -= weight * q[m] * q[k] / n.F1;
    if (n.F2 <= 0) return;
    for (int m = 0; m < 6; ++m) q[m] = Jv[m] - n.shear * Ju[m];
    for (int m = 0; m < 6; ++m)
        for (int k = 0; k < 6; ++k) H[m][k] -= weight * q[m] * q[k] / n.F2;
}

static void transfer(const Pair *P, const double f[3][3], double *force)
{
    for (int k = 0; k < 4; ++k)
        for (int c = 0; c < 3; ++c)
            force[3 * k + c] = P->R[0][k] * f[0][c] + P->R[1][k] * f[1][c] + P->R[2][k] * f[2][c];
}

static void transfer2(const Pair *P, double K9[3][3][9], double *K)
{
    double half[9][12];
    for (int i = 0; i < 3; ++i)
        for (int c = 0; c < 3; ++c)
            for (int k = 0; k < 4; ++k)
                for (int d = 0; d < 3; ++d)
                    half[3 * i + c][3 * k + d] =
                        P->R[0][k] * K9[i][c][d] + P->R[1][k] * K9[i][c][3 + d] + P->R[2][k] * K9[i][c][6 + d];
    for (int k = 0; k < 4; ++k)
        for (int c = 0; c < 3; ++c)
            for (int j = 0; j < 12; ++j)
                K[12 * (3 * k + c) + j] =
                    P->R[0][k] * half[c][j] + P->R[1][k] * half[3 + c][j] + P->R[2][k] * half[6 + c][j];
}

/* Force (12) and tangent (12 x 12) from the stress S (6), its derivative D (6 x 6) and the vectors in which the force
   acts; the end of the step counts for α of them.

   The derivative of the measure of vectors i and j by vector i is vector j, twice if they are the same. */
static void assemble(const Pair *P, const double S[6], double D[6][6], double Ym[3][3], double Y1[3][3], double α,
                     double *force, double *K)
{
    static const int M[3][3] = {{0, 1, 2}, {1, 3, 4}, {2, 4, 5}};
    double Q[3][3] = {{0}}, f[3][3];
    for (int m = 0; m < 6; ++m) Q[I[m]][J[m]] += S[m], Q[J[m]][I[m]] += S[m];
    for (int i = 0; i < 3; ++i)
        for (int c = 0; c < 3; ++c) f[i][c] = Q[i][0] * Ym[0][c] + Q[i][1] * Ym[1][c] + Q[i][2] * Ym[2][c];
    transfer(P, f, force);
    if (!K) return;
    double G1[6][9] = {{0}}, DG[6][9], K9[3][3][9];
    for (int m = 0; m < 6; ++m)
        for (int c = 0; c < 3; ++c) G1[m][3 * I[m] + c] += Y1[J[m]][c], G1[m][3 * J[m] + c] += Y1[I[m]][c];
    for (int m = 0; m < 6; ++m)
        for (int j = 0; j < 9; ++j)
            DG[m][j] = D[m][0] * G1[0][j] + D[m][1] * G1[1][j] + D[m][2] * G1[2][j] + D[m][3] * G1[3][j] +
                       D[m][4] * G1[4][j] + D[m][5] * G1[5][j];
    for (int i = 0; i < 3; ++i) {
        const double *d0 = DG[M[i][0]], *d1 = DG[M[i][1]], *d2 = DG[M[i][2]];
        for (int c = 0; c < 3; ++c) {
            const double y0 = Ym[0][c] * (1 + (i == 0)), y1 = Ym[1][c] * (1 + (i == 1)), y2 = Ym[2][c] * (1 + (i == 2));
            for (int j = 0; j < 9; ++j) K9[i][c][j] = y0 * d0[j] + y1 * d1[j] + y2 * d2[j];
            for (int j = 0; j < 3; ++j) K9[i][c][3 * j + c] += α * Q[i][j];
        }
    }
    transfer2(P, K9, K);
}

/* Whether two triangles' or edges' points have passed through each other on the straight way. */
static int passed(int edges, double U, double V, double Y0[3][3], double Y1[3][3])
{
    const double v0 = triple(Y0), v1 = triple(Y1);
    if (!(v0 * v1 < 0)) return 0;
    double lo = 0, hi = 1, Y[3][3], e[6];
    for (int k = 0; k < 12; ++k) {
        const double t = (lo + hi) / 2;
        for (int i = 0; i < 3; ++i)
            for (int c = 0; c < 3; ++c) Y[i][c] = Y0[i][c] + t * (Y1[i][c] - Y0[i][c]);
        if (triple(Y) * v0 > 0) lo = t;
        else hi = t;
    }
    gram(Y, e);
    const double det = e[3] * e[5] - e[4] * e[4];
    if (!(det > 0)) return 0;
    const double u = (e[4] * e[2] - e[5] * e[1]) / det, v = (e[4] * e[1] - e[3] * e[2]) / det, s = u - U, t = v - V;
    if (!(s >= 0 && t >= 0 && (edges ? s <= 1 && t <= 1 : s + t <= 1))) return 0;
    /* vectors that lie in one plane all the way have a volume of round-off: where they meet, nothing may be between */
    double between = 0, way = 0;
    for (int i = 0; i < 3; ++i) {
        const double w = Y[0][i] + u * Y[1][i] + v * Y[2][i];
        between += w * w;
        for (int k = 0; k < 3; ++k) way += (Y1[k][i] - Y0[k][i]) * (Y1[k][i] - Y0[k][i]);
    }
    return between <= 1e-5 * way;
}

/* The way back of an iterate that has passed through: the energy goes on as a parabola of the signed distance. */
static void push_back(const Pair *P, double Y1[3][3], int through, double d0, double D, double stiffness,
                      double *force, double *K)
{
    double e[6], n[3], c[4], d1 = 0;
    if (P->kind <= EDGE_EDGE) {
        gram(Y1, e);
        const Nearest at = nearest(P->kind == EDGE_EDGE, e, P->U, P->V);
        const double sign = through ? -1 : 1;
        for (int k = 0; k < 3; ++k) n[k] = sign * (Y1[0][k] + at.u * Y1[1][k] + at.v * Y1[2][k]);
        for (int k = 0; k < 4; ++k) c[k] = P->R[0][k] + at.u * P->R[1][k] + at.v * P->R[2][k];
        const double d = sqrt(dot(n, n));
        d1 = sign * d;
        for (int k = 0; k < 3; ++k) n[k] = d > 1e-12 ? n[k] / d : 0;
    } else
        for (int k = 0; k < 4; ++k) c[k] = P->R[0][k];
    if (P->kind == PLANE) {
        memcpy(n, Y1[1], sizeof n);
        d1 = dot(Y1[0], Y1[1]);
    } else if (P->kind > PLANE) { /* towards the middle; d0, D and d1 are distances from the wall */
        double w[3];
        for (int k = 0; k < 3; ++k)
            w[k] = P->kind == IN_SPHERE ? Y1[0][k] : dot(Y1[0], Y1[1]) * Y1[1][k] + dot(Y1[0], Y1[2]) * Y1[2][k];
        const double length = sqrt(dot(w, w));
        d1 = -length;
        for (int k = 0; k < 3; ++k) n[k] = -w[k] / length;
    }
    const int near = d0 < D;
    const double gap = d0 - d1, f = near ? D - (d0 + d1) / 2 : (D - d1) * (D - d1) / (2 * gap);
    const double rise = near ? 0.5 : (D - d1) / gap - (D - d1) * (D - d1) / (2 * gap * gap);
    for (int k = 0; k < 4; ++k)
        for (int i = 0; i < 3; ++i) {
            force[3 * k + i] = -stiffness * f * c[k] * n[i];
            if (K)
                for (int l = 0; l < 4; ++l)
                    for (int j = 0; j < 3; ++j)
                        K[12 * (3 * k + i) + 3 * l + j] = stiffness * rise * c[k] * n[i] * c[l] * n[j];
        }
}

/* How much nearer the two sides of a pair may be at x1 than at x0, or on the straight way: at most. */
static double approach(int kind, const double *x0, const double *x1, const int32_t *p)
{
    double Δ[4][3], mean[3] = {0}, length[4];
    for (int k = 0; k < 4; ++k)
        for (int c = 0; c < 3; ++c) {
            Δ[k][c] = x1[3 * p[k] + c] - x0[3 * p[k] + c];
            mean[c] += Δ[k][c] / 4;
        }
    for (int k = 0; k < 4; ++k) {
        for (int c = 0; c < 3; ++c) Δ[k][c] -= mean[c];
        length[k] = sqrt(dot(Δ[k], Δ[k]));
    }
    return kind == EDGE_EDGE ? fmax(length[0], length[1]) + fmax(length[2], length[3])
                             : length[0] + fmax(length[1], fmax(length[2], length[3]));
}

/* The same for points that end within margins (m), which may be null, of x1. */
void approaches(int n, const int32_t *pairs, const uint8_t *kind, const double *x0, const double *x1,
                const double *margin, double *way)
{
    for (int i = 0; i < n; ++i) {
        const int32_t *p = pairs + 4 * (int64_t)i;
        way[i] = kind[i] <= EDGE_EDGE ? approach(kind[i], x0, x1, p) : INFINITY;
        if (margin && kind[i] <= EDGE_EDGE) {
            const double first = margin[p[0]], second = margin[p[1]], third = fmax(margin[p[2]], margin[p[3]]);
            way[i] += kind[i] == EDGE_EDGE ? fmax(first, second) + third : first + fmax(second, third);
        }
    }
}

/* Of pairs at x0: where they are nearest, (u, v), their distance, and s, which is rounded: start (n, 4); of walls
   nothing. */
void starts(int n, const int32_t *pairs, const uint8_t *kind, const double *x0, const double *S, double ε,
            double *start)
{
    for (int i = 0; i < n; ++i) {
        double Y[3][3], φ[6], *at = start + 4 * (int64_t)i;
        if (kind[i] > EDGE_EDGE) continue;
        Pair P = begin(kind[i], ε * S[i]);
        vectors(P.R, x0, pairs + 4 * i, Y);
        nearest_points(P.kind == EDGE_EDGE, Y, at, at + 1);
        at[2] = sqrt(squared(Y, at[0], at[1]));
        shift(&P, at[0], at[1], Y);
        at[3] = value(&P, Y, φ);
    }
}

/* Forces and tangents of pairs in a step from points x0 to x1 (or in the state x1, if α = 1).

   Of each pair: k [J] its stiffness, S its threshold of s - offset (squared lengths; lengths for planes), and ε the
   part of S by which edges are rounded; γ is the share of the geometric stiffness in tangents; start (n, 4), which may
   be null: see above.  active (n): 0 no force, 1 contact, 2 passed through, or about to, and pushed back; `again`: it is known.
   forces (n, 12) and tangents (n, 144) of pairs, or added by points to `force` and by blocks to `values` where
   `slots` (n, 16) says; any of them may be null.  Returns the number of pairs that act. */
int act(int n, const int32_t *pairs, const uint8_t *kind, const double *x0, const double *x1, const double *k,
        const double *S, const double *offset, const double *start, double ε, int law, double α, double γ, double push,
        int again, uint8_t *active, double *force, const int32_t *slots, double *values, double *forces,
        double *tangents)
{
    int count = 0;
    const int ends = α == 1;
    for (int i = 0; i < n; ++i) {
        const int32_t *p = pairs + 4 * i;
        const int linear = kind[i] >= PLANE;
        const double size = S[i], *at = start && kind[i] <= EDGE_EDGE ? start + 4 * (int64_t)i : 0;
        double f[12], K[144];
        const int tangent = values || tangents;
        int state = 0;
        const int far = again ? !active[i]
                              : at && !ends && at[2] - sqrt(size + offset[i]) > approach(kind[i], x0, x1, p);
        if (far) {
            active[i] = 0;
            if (forces) memset(forces + 12 * i, 0, 12 * sizeof(double));
            if (tangents) memset(tangents + 144 * i, 0, 144 * sizeof(double));
            continue;
        }
        double Y0[3][3], Y1[3][3];
        Pair P = begin(kind[i], ε * size);
        vectors(P.R, ends ? x1 : x0, p, Y0);
        if (P.kind <= EDGE_EDGE) {
            double u, v;
            if (at && !ends) u = at[0], v = at[1];
            else nearest_points(P.kind == EDGE_EDGE, Y0, &u, &v);
            shift(&P, u, v, Y0);
        }
        vectors(P.R, x1, p, Y1);
        double φ0[6], φ1[6];
        const double s0 = at && !ends ? at[3] : value(&P, Y0, φ0), s1 = value(&P, Y1, φ1);
        const double X0 = (s0 - offset[i]) / size, X1 = (s1 - offset[i]) / size;
        const int through = P.kind <= EDGE_EDGE && !ends && passed(P.kind, P.U, P.V, Y0, Y1);
        const int steep = law == BARRIER && P.kind == EDGE_EDGE && !ends && !through && X1 < LOW * fmin(X0, 1);
        const int wrong = through || (X1 <= 0 && !steep && (law == BARRIER || P.kind <= EDGE_EDGE));
        if (wrong && push > 0) {
            const double D = P.kind == PLANE ? size + offset[i] : P.kind > PLANE ? -sqrt(-offset[i] - size) : sqrt(size + offset[i]);
            const double d0 = P.kind == PLANE ? s0 : P.kind > PLANE ? -sqrt(-s0) : sqrt(s0);
            const double length = P.kind <= PLANE ? D - (offset[i] > 0 ? (P.kind == PLANE ? offset[i] : sqrt(offset[i])) : 0)
                                                  : D + sqrt(-offset[i]);
            state = 2;
            push_back(&P, Y1, through, d0, D, push * k[i] / (length * length), f, tangent ? K : 0);
        } else if (X0 < 1 || X1 < 1) {
            double S_[6], D[6][6], Ym[3][3], slope, rise;
            state = steep ? 2 : 1;
            if (ends) {
                memset(D, 0, sizeof D);
                double e[6], H[6][6] = {{0}};
                gram(Y1, e);
                weights(&P, e, φ0, H, 1);
                slope = slope_of(law, linear, X1) / size;
                rise = curvature_of(law, linear, X1) / (size * size);
                for (int m = 0; m < 6; ++m) {
                    S_[m] = k[i] * slope * φ1[m];
                    for (int j = 0; j < 6; ++j) D[m][j] = k[i] * (slope * H[m][j] + rise * φ1[m] * φ1[j]);
                }
                memcpy(Ym, Y1, sizeof Ym);
            } else {
                double e0[6], Δ[6], mean[6] = {0}, H[6][6] = {{0}}, N = 0, size2 = 0, defect = s1 - s0;
                gram(Y0, e0);
                for (int j = 0; j < 3; ++j)
                    for (int c = 0; c < 3; ++c) Ym[j][c] = (Y0[j][c] + Y1[j][c]) / 2;
                for (int m = 0; m < 6; ++m) {
                    Δ[m] = 0;
                    for (int c = 0; c < 3; ++c)
                        Δ[m] += Ym[I[m]][c] * (Y1[J[m]][c] - Y0[J[m]][c]) + (Y1[I[m]][c] - Y0[I[m]][c]) * Ym[J[m]][c];
                    N += Δ[m] * Δ[m], size2 += e0[m] * e0[m];
                }
                for (int g = 0; g < 2; ++g) {
                    double e[6], φ[6];
                    for (int m = 0; m < 6; ++m) e[m] = e0[m] + GAUSS[g] * Δ[m];
                    weights(&P, e, φ, tangent ? H : 0, GAUSS[g] / 2);
                    for (int m = 0; m < 6; ++m) mean[m] += φ[m] / 2;
                }
                for (int m = 0; m < 6; ++m) defect -= mean[m] * Δ[m];
                if (N > 1e-28 * size2) {
                    double row[6];
                    const double c = defect / N;
                    for (int m = 0; tangent && m < 6; ++m) {
                        double sum = 0;
                        for (int j = 0; j < 6; ++j) sum += Δ[j] * H[j][m];
                        row[m] = (φ1[m] - mean[m] - sum - 2 * c * Δ[m]) / N;
                    }
                    for (int m = 0; tangent && m < 6; ++m) {
                        H[m][m] += c;
                        for (int j = 0; j < 6; ++j) H[m][j] += Δ[m] * row[j];
                    }
                    for (int m = 0; m < 6; ++m) mean[m] += c * Δ[m];
                }
                if (steep) { /* s may be below its offset, where a barrier has no energy: it goes on as a parabola of s */
                    const double low = LOW * fmin(X0, 1);
                    secant(law, linear, X0, low, &slope, &rise);
                    slope += rise * (X1 - low);
                } else
                    secant(law, linear, X0, X1, &slope, &rise);
                slope /= size, rise /= size * size;
                for (int m = 0; m < 6; ++m) {
                    S_[m] = k[i] * slope * mean[m];
                    for (int j = 0; tangent && j < 6; ++j)
                        D[m][j] = k[i] * (slope * H[m][j] + rise * mean[m] * φ1[j]);
                }
            }
            assemble(&P, S_, D, Ym, Y1, α * γ, f, tangent ? K : 0);
        }
        active[i] = state;
        count += state > 0;
        if (forces && !state) memset(forces + 12 * i, 0, 12 * sizeof(double));
        if (tangents && !state) memset(tangents + 144 * i, 0, 144 * sizeof(double));
        if (!state) continue;
        if (force)
            for (int j = 0; j < 4; ++j)
                for (int c = 0; c < 3; ++c) force[3 * p[j] + c] += f[3 * j + c];
        if (forces) memcpy(forces + 12 * i, f, sizeof f);
        if (tangents) memcpy(tangents + 144 * i, K, sizeof K);
        if (values)
            for (int j = 0; j < 4; ++j)
                for (int l = 0; l < 4; ++l) {
                    double *block = values + 9 * (int64_t)slots[16 * i + 4 * j + l];
                    for (int c = 0; c < 3; ++c)
                        for (int d = 0; d < 3; ++d) block[3 * c + d] += K[12 * (3 * j + c) + 3 * l + d];
                }
    }
    return count;
}

/* s (n) of pairs in one state, edges rounded, less the offset and over S; returns the energy. */
double energy(int n, const int32_t *pairs, const uint8_t *kind, const double *x, const double *k, const double *S,
              const double *offset, double ε, int law, double *X)
{
    double sum = 0;
    for (int i = 0; i < n; ++i) {
        Pair P = begin(kind[i], ε * S[i]);
        double Y[3][3], φ[6], u, v;
        vectors(P.R, x, pairs + 4 * i, Y);
        if (P.kind <= EDGE_EDGE) {
            nearest_points(P.kind == EDGE_EDGE, Y, &u, &v);
            shift(&P, u, v, Y);
        }
        X[i] = (value(&P, Y, φ) - offset[i]) / S[i];
        sum += k[i] * energy_of(law, kind[i] >= PLANE, X[i]);
    }
    return sum;
}
