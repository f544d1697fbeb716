/* Law kernel: responses of a law at quadrature points, and the choice of strains.

   The C compiler reads this file, and so does cffi, without the preprocessor's lines
   (forms/c_source.py).  Python checks lengths, types and writability of all arrays, and the range
   of all indices, before it calls a function. Shapes stand in brackets; arrays are stored row by
   row.

   c cells with p points each; q rows of point values, q >= c p; m components of a strain.  A
   response is a stress and its derivative by the strain, m + m m numbers. */
#ifndef GOSSAMER_LAW_H
#define GOSSAMER_LAW_H

#include <stddef.h>
#include <stdint.h>

/* A compiled function of the values in one cell, with the signature that FFCx gives to expressions.
   */
typedef struct {
    uintptr_t function;
    const double *constants;
    int argument_count;
    const int32_t *arguments; /* (argument_count) their numbers in the pool of a cell */
} cell_function;

typedef struct {
    ptrdiff_t cell_count;     /* c */
    ptrdiff_t point_count;    /* p */
    ptrdiff_t strain_size;    /* m */
    ptrdiff_t other_count;    /* further values of a cell, on which the law depends */
    ptrdiff_t geometry_size;  /* numbers of the coordinates of a cell */
    /* the first serves every point, the others points in certain cases */
    const cell_function *responses;
    /* the number of the cheapest response for each point; NULL: there is one */
    const cell_function *sort;
    const int32_t *rows;      /* (c, p) row of each point */
    const double *geometry;   /* (c, geometry_size) */
    const double *others;     /* (c, other_count) */
    const double *start;      /* (q, m) strains at the start of the step */
    double *strain;           /* (q, m) strains of the iterate */
    double *response;         /* (q, m + m m) */
    double *pool;             /* (2 p m + other_count) work: the values of one cell */
    double *arguments;        /* (largest argument_count) work */
    double *cell_values;      /* (p (m + m m)) work */
} point_law;

/* Equation (5) of terms/element_energies.py. */
typedef struct {
    const double *linear_strain; /* (q, m) */
    /* (q) error of the stress where a strain was chosen last, infinite elsewhere */
    double *last_error;
    int32_t *fruitless;       /* (q) choices in this step after which the error did not fall */
    double stiffness_ratio;   /* k over the largest stiffness */
    double trigger;           /* relative error of the stress from which a strain is chosen */
    double fruitful_ratio;    /* an error below this part of the last one has fallen */
    int max_fruitless;
    double *forecast;         /* (p, m + 2) work: stress, largest stiffness, change of strain */
    double *equations;        /* (m, m + 1) work */
} strain_choice;

/* Evaluate the responses at all points. */
void evaluate_responses(const point_law *law);

/* Evaluate a scalar function of the strains at the start: values (q). */
void evaluate_density(const point_law *law, const cell_function *density, double *values);

/* Choose the strains of the iterate by equation (5), and evaluate the responses; returns whether
   any strain differs from the linear one. */
int choose_strains(const point_law *law, const strain_choice *choice);

#endif
