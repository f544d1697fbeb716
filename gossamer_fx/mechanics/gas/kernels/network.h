/* Mass and energy balance of a network of chambers, openings and walls; see gas/balance.py for the
   equations (1) to (5) and the signs.  Flows, heats and properties of gases are compiled laws
   (core/laws), of which the network has the addresses.

   The C compiler reads this file, and so does cffi, without the preprocessor's lines
   (forms/c_source.py).  Python checks lengths and types of all arrays, and the range of all
   numbers.  Shapes stand in brackets; arrays are stored row by row.

   n chambers with s masses, m openings with r state variables, w walls, b boundaries, g species;
   y (n + s + r) are pressures [Pa], masses [kg], then state variables, V and W (n) volumes at the
   end of the step and swept volumes [m^3].  A state of gas is that of a chamber, 0 to n - 1, or of a
   boundary, n to n + b - 1; its species have local numbers. */
#ifndef GOSSAMER_GAS_NETWORK_H
#define GOSSAMER_GAS_NETWORK_H

#include <stddef.h>
#include <stdint.h>

typedef void (*gas_law)(const double *x, double *f, double *df, double *ddf);

typedef struct {
    ptrdiff_t chamber_count;        /* n */
    ptrdiff_t mass_count;           /* s */
    ptrdiff_t opening_count;        /* m */
    ptrdiff_t wall_count;           /* w */
    ptrdiff_t boundary_count;       /* b */
    ptrdiff_t species_count;        /* g */
    ptrdiff_t variable_count;       /* r */
    ptrdiff_t number_count;         /* of openings, by which there are derivatives */
    int32_t *process;               /* (1) 0 step in time, 1 adiabatic, 2 isothermal, 3 held */

    /* Species: u [J/kg] and c_v [J/(kg K)] of the temperature */
    const double *R;                /* (g) specific gas constants [J/(kg K)] */
    const gas_law *heat;            /* (g) laws of (T, numbers) with derivatives by T */
    double *heat_inputs;            /* their arguments */
    const int32_t *heat_first;      /* (g + 1) where those of a species begin */

    /* States */
    const int32_t *state_first;     /* (n + b + 1) where the species of a state begin */
    const int32_t *state_species;   /* numbers of species; the first s are those of the masses */
    const double *fractions;        /* mass fractions, of boundaries alone */
    const double *boundary;         /* (b, 2) pressure [Pa] and temperature [K] in the step */

    /* Openings: mass flow [kg/s] from the first to the second end, of
       (p, T, R, gamma, Y of its species) at both ends, area and numbers, and the rates of its state
       variables, which are some of the numbers */
    const int32_t *ends;            /* (m, 2) numbers of states */
    const gas_law *flow;            /* (m) laws, by properties of both ends and state variables */
    const gas_law *slopes;          /* (m) the same with the slopes of the flow by both pressures as
                                       further outputs, by all properties, the area, state variables
                                       and numbers with derivatives; null in runs */
    const int32_t *by_count;        /* (m) properties of an end by which `flow` is derived */
    ptrdiff_t max_outputs;          /* most outputs of one of `slopes` */
    ptrdiff_t max_by;               /* most inputs by which one is derived */
    const int32_t *variable_first;  /* (m + 1) where the state variables of an opening begin */
    const int32_t *variable_input;  /* (r) where they are in the arguments of their law */
    const int32_t *number_first;    /* (m + 1) where its numbers with derivatives begin */
    double *inputs;                 /* arguments of the laws */
    const int32_t *input_first;     /* (m + 1) where those of an opening begin */
    const int32_t *carried_first;   /* (m + 1) where the species of an opening begin */
    const int32_t *local;           /* (., 2) number of a species in the states of the ends; -1 */
    const double *carried;          /* mass fractions of what flows; -1 for those upstream */
    const int32_t *carried_species; /* numbers of the species of openings */
    const int32_t *driven;          /* (m) whether it flows at equal pressures */
    const double *area;             /* (m) [m^2] */

    /* Walls: heat [W] and conductance [W/K] of (T, temperature of the wall, size) */
    const int32_t *wall_chamber;    /* (w) */
    const gas_law *heat_flow;       /* (w) laws of two outputs, by all arguments */
    const double *wall_state;       /* (w, 2) temperature [K] and size */

    gas_law weight;                 /* theta of (zeta, z), by both */

    /* Of the present step: */
    double *h;                      /* (1) length [s] */
    const double *p0, *m0, *U0, *V0; /* (n), (s), (n), (n) at its start */
    double *pV0, *T0, *theta;       /* (n) p0 V0 [J], temperature [K], weight of p1 in flows */
    double *amplification;          /* (n) of round-off by openings and walls */
    double *exponent;               /* (n) gamma - 1 at the start */
    double *wall_theta;             /* (w) weight of the end in the temperature at walls */
    const double *x0;               /* (r) state variables at its start */
    const double *end_share;        /* (1) weight of the end in state variables */

    /* Of the solution: */
    ptrdiff_t max_iterations;
    ptrdiff_t max_halvings;
    double round_off;         /* share of cancelled and amplified round-off in the scales */
    double tolerance;         /* scaled residual of a solution */
    double acceptable;        /* one that is accepted where round-off ends the iteration */
    double remaining;         /* pressures and masses fall at most to this share in an iteration */
    double rest_difference;   /* share of the pressure at which a conductance is measured */
    double smallest_volume;   /* share of V0 below which adiabatic work is constant */
    double *work;             /* of the length `gas_work_length` */
    int32_t *columns;         /* (n + b, 4 g + 8) */
} gas_network;

/* Length of `work` for the other numbers of a network. */
ptrdiff_t gas_work_length(const gas_network *network);

/* Number of columns of all derivatives: by p1 (n), m1 (s), x1 (r), V1 (n), p0 (n), m0 (s), V0 (n),
   theta (n), weights of walls (w), pressure and temperature of boundaries (b, 2), areas (m),
   temperatures and sizes of walls (w, 2), W (n), x0 (r), numbers of openings. */
ptrdiff_t gas_column_count(const gas_network *network);

/* Start a step: set pV0 to exponent, and the weights of flows and heats by (4) and (5). */
void gas_begin(const gas_network *network);

/* Set the derivatives (n + w, columns) of the weights theta of chambers and walls. */
void gas_weight_derivatives(const gas_network *network, double *by_all);

/* Set the flows through openings [kg/s] (m), the sums of mass flows (s) and energy flows [W] (n)
   into chambers, and mass and energy flows from boundaries and walls (2). */
void gas_rates(const gas_network *network, const double *y, const double *V, double *openings,
               double *mass, double *energy, double *supplied);

/* Set the work [J] of each chamber on what encloses it, (n). */
void gas_work(const gas_network *network, const double *y, const double *V, const double *W,
              double *work);

/* Set the excess of energy [J], then mass [kg], in each chamber over its balance, then that of state
   variables over what their rates give, (n + s + r). */
void gas_residual(const gas_network *network, const double *y, const double *V, const double *W,
                  double *residual);

/* Set the derivatives (n + s + r, 2 n + s + r) of the residual by y and V, or by all columns if
   `all`. */
void gas_derivatives(const gas_network *network, const double *y, const double *V, const double *W,
                     int32_t all, double *by);

/* Set the energies [J], masses [kg], then state variables, to which the residual is compared,
   (n + s + r); magnitude (n) is the sum of the sizes of the terms of a volume [m^3]. */
void gas_scales(const gas_network *network, const double *y, const double *V,
                const double *magnitude, double *scale);

/* Solve the balance for y, from a positive guess, by Newton's method with backtracking.  The
   residual is divided by the scales of the guess plus what flows in the step there.  Returns
   whether y is a solution. */
int gas_solve(const gas_network *network, double *y, const double *V, const double *W,
              const double *magnitude);

#endif
