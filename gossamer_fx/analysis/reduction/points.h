/* The points of a reduced film: strains, forces and stiffness.

   The C compiler reads this file, and so does cffi, without the preprocessor's lines: see
   forms/c_source.py.  Shapes stand in brackets; q points, r modes.  Strains are (E11, E22, 2 E12);
   a response is a stress and its derivative, 3 and 9 numbers.  F are the images of the two frame
   vectors at each point. */
#ifndef GOSSAMER_POINTS_H
#define GOSSAMER_POINTS_H

#include <stddef.h>

typedef struct {
    ptrdiff_t count;        /* q */
    const double *dA;       /* (q) [m^2] */
    const double *initial;  /* (q, 3) initial strain, added to that of F */
    const double *strain;   /* (q, 3) of the iterate, with the initial one */
    const double *response; /* (q, 12) */
} point_stresses;

/* The states between which forces and tangents are taken. */
typedef struct {
    const double *F0; /* (q, 2, 3) at the start of the step */
    const double *F;  /* (q, 2, 3) at its end */
    double alpha;     /* weight of the end where forces act */
} point_gradients;

/* Strains (q, 3) of F (q, 2, 3).  Of their second derivative along dF (q, 2, 3) half is taken off,
   unless dF is NULL: the strains are then linear about F - dF. */
void strains(ptrdiff_t count, const double *F, const double *dF, double *strain);

/* N_a = sum over b of S_ab Fm_b dA (q, 2, 3), Fm = (1 - alpha) F0 + alpha F, with the stress that
   is linear in the true strain of F. */
void forces(const point_stresses *stresses, const point_gradients *at, double *N);

/* Sum over c of T_ac G_c (q, 2, 3, 3, r) with T_ac = (sum over b, d of D_abcd Fm_b (x) F_d + share
   S_ac 1) dA and G (q, 2, r). */
void stiffness_times(const point_stresses *stresses, const point_gradients *at, double share, int r,
                     const double *G,
                     double *TG);

#endif
