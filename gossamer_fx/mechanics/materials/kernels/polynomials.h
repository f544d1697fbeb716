/* Values and derivatives of polynomials by Horner's rule; coefficients begin with that of the
   zeroth power. */
#ifndef GOSSAMER_POLYNOMIALS_H
#define GOSSAMER_POLYNOMIALS_H

#include <math.h>

static inline double value2(const double *a, double x) { return a[0] + x * (a[1] + x * a[2]); }

static inline double slope2(const double *a, double x) { return a[1] + 2 * x * a[2]; }

static inline double value4(const double *a, double x) { return a[0] + x * (a[1] + x * (a[2] + x * (a[3] + x * a[4]))); }

static inline double slope4(const double *a, double x) { return a[1] + x * (2 * a[2] + x * (3 * a[3] + x * 4 * a[4])); }

static inline double curvature4(const double *a, double x) { return 2 * a[2] + x * (6 * a[3] + x * 12 * a[4]); }

/* Halley's step towards a root, whose errors fall by the third power; Newton's where they differ
   much: Halley's steps vanish where the slope does. */
static inline double halley_step(double value, double slope, double curvature)
{
    const double square = slope * slope;
    const double bend = value * curvature / 2;
    return value * slope / (fabs(bend) < square / 2 ? square - bend : square);
}

#endif
