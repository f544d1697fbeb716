/* The energy b(x) of a pair of unit stiffness, its derivatives, and its secant between two states;
   zero for x >= 1.

       BARRIER   (1 - x)^3/(4 x)
       PENALTY   (1 - sqrt x)^2/2, or (1 - x)^2/2 if x is a ratio of distances, not of their
                 squares: `is_linear` */
#ifndef GOSSAMER_CONTACT_LAW_H
#define GOSSAMER_CONTACT_LAW_H

#include <math.h>

#include "contact.h"

/* Of sqrt x in derivatives of the penalty, which grow without bound where points coincide. */
static const double SMALLEST_SCALED_DISTANCE = 1e-30;

typedef struct {
    int law;
    int is_linear;
} contact_energy;

typedef struct {
    double slope;      /* (b(x1) - b(x0))/(x1 - x0) */
    double derivative; /* of the slope with respect to x1 */
} energy_secant;

/* b(x); NAN for a barrier beyond its end. */
static inline double energy_of(contact_energy b, double x)
{
    if (x >= 1) return 0;
    if (b.law == BARRIER) return x > 0 ? (1 - x) * (1 - x) * (1 - x) / (4 * x) : NAN;
    const double d = b.is_linear ? x : sqrt(x > 0 ? x : 0);
    return (1 - d) * (1 - d) / 2;
}

/* b'(x) */
static inline double slope_of(contact_energy b, double x)
{
    if (x >= 1) return 0;
    if (b.law == BARRIER) return x > 0 ? (3 - 2 * x - 1 / (x * x)) / 4 : NAN;
    if (b.is_linear) return x - 1;
    const double d = sqrt(x > SMALLEST_SCALED_DISTANCE ? x : SMALLEST_SCALED_DISTANCE);
    return -(1 - d) / (2 * d);
}

/* b''(x) */
static inline double curvature_of(contact_energy b, double x)
{
    if (x >= 1) return 0;
    if (b.law == BARRIER) return (1 / (x * x * x) - 1) / 2;
    if (b.is_linear) return 1;
    const double d = sqrt(x > SMALLEST_SCALED_DISTANCE ? x : SMALLEST_SCALED_DISTANCE);
    return 1 / (4 * d * d * d);
}

/* Where both ends touch, closed forms: the difference of nearly equal energies would lose its
   digits. */
static inline energy_secant secant_of(contact_energy b, double x0, double x1)
{
    if (!(x0 < 1 && x1 < 1)) {
        const double change = x1 - x0;
        const double slope = (energy_of(b, x1) - energy_of(b, x0)) / change;
        return (energy_secant){slope, (slope_of(b, x1) - slope) / change};
    }
    if (b.law == BARRIER) {
        const double slope = x1 > 0 ? (3 - x0 - x1 - 1 / (x0 * x1)) / 4 : NAN;
        return (energy_secant){slope, (1 / (x0 * x1 * x1) - 1) / 4};
    }
    if (b.is_linear) return (energy_secant){(x0 + x1) / 2 - 1, 0.5};
    const double d0 = sqrt(x0 > 0 ? x0 : 0);
    const double d1 = sqrt(x1 > SMALLEST_SCALED_DISTANCE ? x1 : SMALLEST_SCALED_DISTANCE);
    return (energy_secant){0.5 - 1 / (d0 + d1), 1 / ((d0 + d1) * (d0 + d1) * 2 * d1)};
}

#endif
