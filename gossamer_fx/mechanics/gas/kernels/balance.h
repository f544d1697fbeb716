/* Mass and energy balance of chambers of one gas with constant specific heats, which are connected
   by isentropic openings; see gas/balance.py for the equations (1) to (3) and the signs.

   The C compiler reads this file, and so does cffi, without the preprocessor's lines
   (forms/c_source.py).  Python checks lengths and types of all arrays, and the range of all
   numbers of chambers.  Shapes stand in brackets; arrays are stored row by row.

   n chambers, m openings; y (2 n) are pressures [Pa], then masses [kg], V and W (n) volumes at the
   end of the step and swept volumes [m^3]. */
#ifndef GOSSAMER_GAS_BALANCE_H
#define GOSSAMER_GAS_BALANCE_H

#include <stddef.h>
#include <stdint.h>

typedef struct {
    ptrdiff_t chamber_count;  /* n */
    ptrdiff_t opening_count;  /* m */
    double R;                 /* specific gas constant [J/(kg K)] */
    double gamma;             /* ratio of specific heats */
    const int32_t *ends;      /* (m, 2) numbers of chambers; -1 at a boundary */
    const double *laminar;    /* (m) relative pressure difference below which the flow is laminar */

    /* Of the present step: */
    double *h;                /* (1) length [s] */
    const double *area;       /* (m) effective area C_d A [m^2] */
    const double *boundary;   /* (m, 2, 2) pressure [Pa] and temperature [K] of boundaries */
    const double *start;      /* (6, n) p0 [Pa], m0 [kg], U0 and p0 V0 [J], weight of p1 in flows,
                                 amplification of round-off by the openings */

    /* Of the solution: */
    ptrdiff_t max_iterations;
    ptrdiff_t max_halvings;
    double round_off;         /* share of cancelled and amplified round-off in the scales */
    double tolerance;         /* scaled residual of a solution */
    double acceptable;        /* one that is accepted where round-off ends the iteration */
    double remaining;         /* pressures and masses fall at most to this share in an iteration */
    double *work;             /* (6 n n + 10 n) */
} gas_network;

/* Set the excess of energy [J], then mass [kg], in each chamber over its balance, (2 n). */
void gas_residual(const gas_network *network, const double *y, const double *V, const double *W,
                  double *residual);

/* Set the derivatives of the residual by y (2 n, 2 n) and by V (2 n, n). */
void gas_derivatives(const gas_network *network, const double *y, const double *V, const double *W,
                     double *by_y, double *by_V);

/* Set the energies [J], then masses [kg], to which the residual is compared, (2 n); magnitude (n) is
   the sum of the sizes of the terms of a volume [m^3]. */
void gas_scales(const gas_network *network, const double *y, const double *V,
                const double *magnitude, double *scale);

/* Solve the balance for y, from a positive guess, by Newton's method with backtracking.  The
   residual is divided by the scales of the guess plus what flows in the step there.  Returns
   whether y is a solution. */
int gas_solve(const gas_network *network, double *y, const double *V, const double *W,
              const double *magnitude);

#endif
