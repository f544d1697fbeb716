/* Strains, forces and stiffness at the quadrature points of a reduced film: see points.h and
   reduced_energies.py. */
#include "points.h"

/* Numbers of a response: a stress (S11, S22, S12) and its derivatives, row by row. */
#define RESPONSE 12

static inline double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/* The strain (3) of the images F (2, 3) of the frame. */
static void strain_of(const double *F, double *strain)
{
    strain[0] = (dot(F, F) - 1) / 2;
    strain[1] = (dot(F + 3, F + 3) - 1) / 2;
    strain[2] = dot(F, F + 3);
}

void strains(ptrdiff_t count, const double *F, const double *dF, double *strain)
{
    for (ptrdiff_t i = 0; i < count; i++) {
        double *e = strain + 3 * i;
        strain_of(F + 6 * i, e);
        if (dF == NULL) continue;
        const double *change = dF + 6 * i;
        e[0] -= dot(change, change) / 2;
        e[1] -= dot(change + 3, change + 3) / 2;
        e[2] -= dot(change, change + 3);
    }
}

/* The images (2, 3) at which forces act at a point. */
static void mean_images(const point_gradients *at, ptrdiff_t i, double *mean)
{
    for (int k = 0; k < 6; k++) mean[k] = (1 - at->alpha) * at->F0[6 * i + k] + at->alpha * at->F[6 * i + k];
}

void forces(const point_stresses *stresses, const point_gradients *at, double *N)
{
    for (ptrdiff_t i = 0; i < stresses->count; i++) {
        const double *initial = stresses->initial + 3 * i;
        const double *strain = stresses->strain + 3 * i;
        const double *S = stresses->response + RESPONSE * i;
        const double *D = S + 3;
        double change[3];
        strain_of(at->F + 6 * i, change);
        for (int j = 0; j < 3; j++) change[j] += initial[j] - strain[j];
        double stress[3];
        for (int j = 0; j < 3; j++) stress[j] = (S[j] + dot(D + 3 * j, change)) * stresses->dA[i];
        double mean[6];
        mean_images(at, i, mean);
        for (int x = 0; x < 3; x++) {
            N[6 * i + x] = stress[0] * mean[x] + stress[2] * mean[3 + x];
            N[6 * i + 3 + x] = stress[1] * mean[3 + x] + stress[2] * mean[x];
        }
    }
}

/* The derivative B (3, 6) of the strain by the images of the frame. */
static void strain_operator(const double *images, double B[3][6])
{
    for (int x = 0; x < 3; x++) {
        B[0][x] = images[x];
        B[0][3 + x] = 0;
        B[1][x] = 0;
        B[1][3 + x] = images[3 + x];
        B[2][x] = images[3 + x];
        B[2][3 + x] = images[x];
    }
}

/* The stiffness T (6, 6) of a point: forces by the images of the frame. */
static void point_stiffness(const double *response, double dA, double share, double B_mean[3][6],
                            double B[3][6],
                            double T[6][6])
{
    const double *S = response;
    const double *D = response + 3;
    double DB[3][6];
    for (int k = 0; k < 3; k++)
        for (int j = 0; j < 6; j++) DB[k][j] = (D[3 * k] * B[0][j] + D[3 * k + 1] * B[1][j] + D[3 * k + 2] * B[2][j]) * dA;
    for (int m = 0; m < 6; m++)
        for (int j = 0; j < 6; j++)
            T[m][j] = B_mean[0][m] * DB[0][j] + B_mean[1][m] * DB[1][j] + B_mean[2][m] * DB[2][j];
    for (int x = 0; x < 3; x++) {
        T[x][x] += share * S[0] * dA;
        T[3 + x][3 + x] += share * S[1] * dA;
        T[x][3 + x] += share * S[2] * dA;
        T[3 + x][x] += share * S[2] * dA;
    }
}

void stiffness_times(const point_stresses *stresses, const point_gradients *at, double share, int r,
                     const double *G,
                     double *TG)
{
    for (ptrdiff_t i = 0; i < stresses->count; i++) {
        double mean[6];
        mean_images(at, i, mean);
        double B_mean[3][6];
        double B[3][6];
        double T[6][6];
        strain_operator(mean, B_mean);
        strain_operator(at->F + 6 * i, B);
        point_stiffness(stresses->response + RESPONSE * i, stresses->dA[i], share, B_mean, B, T);
        const double *G1 = G + 2 * r * i;
        const double *G2 = G1 + r;
        for (int m = 0; m < 6; m++)
            for (int y = 0; y < 3; y++) {
                double *out = TG + (18 * i + 3 * m + y) * r;
                for (int j = 0; j < r; j++) out[j] = T[m][y] * G1[j] + T[m][3 + y] * G2[j];
            }
    }
}
