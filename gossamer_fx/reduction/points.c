/* What happens at the quadrature points of a reduced film: see reduced_energies.py, and terms/element_energies.py for
   the iteration.  Strains are (E11, E22, 2 E12); a response is a stress and its derivative, 3 and 9 numbers. */

#include "points.h"

#include <math.h>
#include <string.h>

#define RESPONSE 12

/* The functions that FFCx makes have an argument more from version 0.10 on. */
#ifdef KERNELS_TAKE_DATA
typedef void (*tabulate)(double *, const double *, const double *, const double *, const int *, const uint8_t *, void *);
#define NO_DATA , NULL
#else
typedef void (*tabulate)(double *, const double *, const double *, const double *, const int *, const uint8_t *);
#define NO_DATA
#endif

static double larger(double a, double b) { return a > b ? a : b; }

/* An expression of the law at the points of one cell, of the numbers in the pool. */
static void call(const film *f, const expression *of, const double *x, double *out, ptrdiff_t size)
{
    for (int i = 0; i < of->n; i++)
        f->arguments[i] = f->pool[of->from[i]];
    memset(out, 0, (size_t)size * sizeof(double));
    ((tabulate)of->function)(out, f->arguments, of->constants, x, NULL, NULL NO_DATA);
}

/* Put the numbers of one cell of which expressions are made into the pool; returns where its nodes are. */
static const double *fill(const film *f, ptrdiff_t cell)
{
    const ptrdiff_t n = 3 * f->points;
    memcpy(f->pool, f->start + cell * n, (size_t)n * sizeof(double));
    memcpy(f->pool + n, f->strain + cell * n, (size_t)n * sizeof(double));
    memcpy(f->pool + 2 * n, f->other + cell * f->others, (size_t)f->others * sizeof(double));
    return f->x + cell * f->geometry;
}

/* Responses in one cell, by the cheapest expression that serves all of its points. */
static void respond(const film *f, ptrdiff_t cell)
{
    const ptrdiff_t p = f->points;
    int which = 0;
    const double *x = fill(f, cell);
    if (f->sort != NULL) {
        double *cases = f->of_points;
        call(f, f->sort, x, cases, p);
        which = (int)cases[0];
        for (ptrdiff_t i = 1; i < p; i++)
            if (cases[i] != cases[0])
                which = 0;
    }
    call(f, f->law + which, x, f->response + cell * p * RESPONSE, p * RESPONSE);
}

/* The strain of the images a, b of the frame, which follow each other; da, db likewise: half of its second derivative
   along them is taken off, if they are there. */
static void strain_of(const double *a, const double *da, double *e)
{
    const double *b = a + 3;
    e[0] = (a[0] * a[0] + a[1] * a[1] + a[2] * a[2] - 1) / 2;
    e[1] = (b[0] * b[0] + b[1] * b[1] + b[2] * b[2] - 1) / 2;
    e[2] = a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    if (da == NULL)
        return;
    const double *db = da + 3;
    e[0] -= (da[0] * da[0] + da[1] * da[1] + da[2] * da[2]) / 2;
    e[1] -= (db[0] * db[0] + db[1] * db[1] + db[2] * db[2]) / 2;
    e[2] -= da[0] * db[0] + da[1] * db[1] + da[2] * db[2];
}

/* x = A⁻¹ b of a symmetric 3 × 3 matrix; the caller has added to its diagonal what makes it positive definite. */
static void solve(const double *A, const double *b, double *x)
{
    double c0 = A[4] * A[8] - A[5] * A[7], c1 = A[5] * A[6] - A[3] * A[8], c2 = A[3] * A[7] - A[4] * A[6];
    double d = A[0] * c0 + A[1] * c1 + A[2] * c2;
    x[0] = (c0 * b[0] + (A[2] * A[7] - A[1] * A[8]) * b[1] + (A[1] * A[5] - A[2] * A[4]) * b[2]) / d;
    x[1] = (c1 * b[0] + (A[0] * A[8] - A[2] * A[6]) * b[1] + (A[2] * A[3] - A[0] * A[5]) * b[2]) / d;
    x[2] = (c2 * b[0] + (A[1] * A[6] - A[0] * A[7]) * b[1] + (A[0] * A[4] - A[1] * A[3]) * b[2]) / d;
}

/* The strain is the true one of F (way 0), the one that follows linearly from the last iterate (1), or is there (2). */
void set_strains(const film *f, const double *F, const double *dF, int way)
{
    for (ptrdiff_t cell = 0; cell < f->cells; cell++) {
        for (ptrdiff_t i = cell * f->points; i < (cell + 1) * f->points && way < 2; i++)
            strain_of(F + 6 * i, way ? dF + 6 * i : NULL, f->strain + 3 * i);
        respond(f, cell);
    }
}

/* The strain lies between the linear one and the one that has the linearised stress, where those are far from each
   other; returns whether they are anywhere. */
int choose_strains(const film *f, const double *F, const double *dF, double surroundings, double far, double falls,
                   int most)
{
    const ptrdiff_t p = f->points;
    int found = 0;
    double *wanted = f->of_points + p, *stiffness = wanted + 3 * p, *way = stiffness + p;
    for (ptrdiff_t cell = 0; cell < f->cells; cell++) {
        for (ptrdiff_t k = 0; k < p; k++) {
            const ptrdiff_t i = cell * p + k;
            double *e = f->strain + 3 * i, *S = f->response + RESPONSE * i, *D = S + 3, change[3], linear[3];
            strain_of(F + 6 * i, dF + 6 * i, linear);
            for (int j = 0; j < 3; j++)
                change[j] = linear[j] - e[j];
            for (int j = 0; j < 3; j++)
                wanted[3 * k + j] = S[j] + D[3 * j] * change[0] + D[3 * j + 1] * change[1] + D[3 * j + 2] * change[2];
            stiffness[k] = larger(larger(D[0], D[4]), D[8]);
            way[k] = sqrt(change[0] * change[0] + change[1] * change[1] + change[2] * change[2]);
            memcpy(e, linear, sizeof linear);
        }
        respond(f, cell);
        int again = 0;
        for (ptrdiff_t k = 0; k < p; k++) {
            const ptrdiff_t i = cell * p + k;
            double *e = f->strain + 3 * i, *S = f->response + RESPONSE * i, *D = S + 3, misses = 0, stress = 0;
            for (int j = 0; j < 3; j++) {
                misses = larger(misses, fabs(S[j] - wanted[3 * k + j]));
                stress = larger(stress, larger(fabs(S[j]), fabs(wanted[3 * k + j])));
            }
            double resistance = surroundings * larger(stiffness[k], larger(larger(D[0], D[4]), D[8]));
            int is_far = misses > far * stress && resistance > 0;
            f->idle[i] += is_far && misses > falls * f->missed[i];
            f->missed[i] = is_far ? misses : INFINITY;
            if (!is_far || f->idle[i] >= most)
                continue;
            double K[9], right[3], change[3];
            for (int j = 0; j < 9; j++)
                K[j] = D[j] + (j % 4 ? 0 : resistance);
            for (int j = 0; j < 3; j++)
                right[j] = wanted[3 * k + j] - S[j];
            solve(K, right, change);
            double length = sqrt(change[0] * change[0] + change[1] * change[1] + change[2] * change[2]);
            double share = length > way[k] ? way[k] / length : 1;
            for (int j = 0; j < 3; j++)
                e[j] += share * change[j];
            again = 1;
        }
        if (again)
            respond(f, cell);
        found |= again;
    }
    return found;
}

/* Σ ψ dA at the start of the step. */
double energy(const film *f)
{
    double sum = 0, *density = f->of_points;
    for (ptrdiff_t cell = 0; cell < f->cells; cell++) {
        const double *x = fill(f, cell);
        call(f, f->energy, x, density, f->points);
        for (ptrdiff_t i = 0; i < f->points; i++)
            sum += density[i] * f->dA[cell * f->points + i];
    }
    return sum;
}

/* N_a = Σ_b S_ab F̄_b dA (points, 2, 3), with the stress that is linear in the true strain of F. */
void forces(const film *f, const double *F0, const double *F, double alpha, double *N)
{
    for (ptrdiff_t i = 0; i < f->cells * f->points; i++) {
        const double *e = f->strain + 3 * i, *S = f->response + RESPONSE * i, *D = S + 3;
        double change[3], s[3];
        strain_of(F + 6 * i, NULL, change);
        for (int j = 0; j < 3; j++)
            change[j] -= e[j];
        for (int j = 0; j < 3; j++)
            s[j] = (S[j] + D[3 * j] * change[0] + D[3 * j + 1] * change[1] + D[3 * j + 2] * change[2]) * f->dA[i];
        for (int x = 0; x < 3; x++) {
            double a = (1 - alpha) * F0[6 * i + x] + alpha * F[6 * i + x];
            double b = (1 - alpha) * F0[6 * i + 3 + x] + alpha * F[6 * i + 3 + x];
            N[6 * i + x] = s[0] * a + s[2] * b;
            N[6 * i + 3 + x] = s[1] * b + s[2] * a;
        }
    }
}

/* Σ_c T_ac G_c (points, 2, 3, 3, r) with T_ac = (Σ_bd D_abcd F̄_b ⊗ F_d + share S_ac 1) dA and G (points, 2, r). */
void stiffness_times(const film *f, const double *F0, const double *F, double alpha, double share, int r,
                     const double *G, double *TG)
{
    for (ptrdiff_t i = 0; i < f->cells * f->points; i++) {
        const double *S = f->response + RESPONSE * i, *D = S + 3, *a = F + 6 * i, *b = a + 3;
        const double *g0 = G + 2 * r * i, *g1 = g0 + r;
        double B[3][6], B0[3][6], DB[3][6], T[6][6];
        for (int x = 0; x < 3; x++) {
            double a0 = (1 - alpha) * F0[6 * i + x] + alpha * a[x], b0 = (1 - alpha) * F0[6 * i + 3 + x] + alpha * b[x];
            B[0][x] = B[2][3 + x] = a[x], B[1][3 + x] = B[2][x] = b[x], B[0][3 + x] = B[1][x] = 0;
            B0[0][x] = B0[2][3 + x] = a0, B0[1][3 + x] = B0[2][x] = b0, B0[0][3 + x] = B0[1][x] = 0;
        }
        for (int k = 0; k < 3; k++)
            for (int j = 0; j < 6; j++)
                DB[k][j] = (D[3 * k] * B[0][j] + D[3 * k + 1] * B[1][j] + D[3 * k + 2] * B[2][j]) * f->dA[i];
        for (int m = 0; m < 6; m++)
            for (int j = 0; j < 6; j++)
                T[m][j] = B0[0][m] * DB[0][j] + B0[1][m] * DB[1][j] + B0[2][m] * DB[2][j];
        for (int x = 0; x < 3; x++) {
            T[x][x] += share * S[0] * f->dA[i], T[3 + x][3 + x] += share * S[1] * f->dA[i];
            T[x][3 + x] += share * S[2] * f->dA[i], T[3 + x][x] += share * S[2] * f->dA[i];
        }
        for (int m = 0; m < 6; m++)
            for (int y = 0; y < 3; y++) {
                double *out = TG + (18 * i + 3 * m + y) * r, t0 = T[m][y], t1 = T[m][3 + y];
                for (int j = 0; j < r; j++)
                    out[j] = t0 * g0[j] + t1 * g1[j];
            }
    }
}
