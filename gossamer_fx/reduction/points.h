/* The points of a reduced film: the data that Python hands over, and the functions that it calls.

   The C compiler reads this file, and so does cffi, without the preprocessor's lines: see forms/c_source.py.  Shapes
   stand in brackets; c cells with p points each, q = c p points in all, r modes.  Strains are (E11, E22, 2 E12); a
   response is a stress and its derivative, 3 and 9 numbers. */
#ifndef GOSSAMER_POINTS_H
#define GOSSAMER_POINTS_H

#include <stddef.h>
#include <stdint.h>

/* An expression that FFCx has compiled. */
typedef struct {
    uintptr_t function;      /* its tabulate function */
    const double *constants; /* its constants, one after the other */
    int n;                   /* numbers of one cell that it needs */
    const int32_t *from;     /* (n) where they stand in the pool of a cell */
} expression;

typedef struct {
    ptrdiff_t cells;   /* c */
    ptrdiff_t points;  /* p */
    ptrdiff_t others;  /* further numbers of a cell, on which the law depends */
    ptrdiff_t geometry; /* numbers of the coordinates of a cell */
    const expression *sort; /* which law is the cheapest that serves a point; NULL: there is one */
    const expression *law;
    const expression *energy;
    const double *x;     /* (c, geometry) */
    const double *other; /* (c, others) */
    const double *dA;    /* (c, p) [m^2] */
    double *start;       /* (q, 3) strains at the start of the step */
    double *strain;      /* (q, 3) of the iteration */
    double *response;    /* (q, 12) */
    double *missed;      /* (q) */
    int32_t *idle;       /* (q) */
    double *pool;        /* (6 p + others) work: the numbers of one cell */
    double *arguments;   /* (largest n of an expression) work */
    double *of_points;   /* (6 p) work */
} film;

void set_strains(const film *f, const double *F, const double *dF, int way);

int choose_strains(const film *f, const double *F, const double *dF, double surroundings, double far, double falls,
                   int most);

double energy(const film *f);

void forces(const film *f, const double *F0, const double *F, double alpha, double *N);

void stiffness_times(const film *f, const double *F0, const double *F, double alpha, double share, int r,
                     const double *G, double *TG);

#endif
