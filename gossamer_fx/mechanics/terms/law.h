/* Law kernel: responses of a law at quadrature points, and the choice of strains.

   The C compiler reads this file, and so does cffi, without the preprocessor's lines
   (forms/c_source.py).  Python checks lengths, types and writability of all arrays, and the range
   of all indices, before it calls a function. Shapes stand in brackets; arrays are stored row by
   row.

   c cells with p points each; q rows of point values, q >= c p; m components of a strain.  A
   response is a stress and its derivative by the strain, m + m m numbers. */
#ifndef GOSSAMER_LAW_H
#define GOSSAMER_LAW_H

#include "../../core/forms/cells.h"

typedef struct {
    cell_set cells;           /* c */
    ptrdiff_t point_count;    /* p */
    ptrdiff_t strain_size;    /* m */
    /* the first serves every point, the others points in certain cases */
    const cell_function *responses;
    ptrdiff_t function_count; /* of responses and sort */
    /* the number of the cheapest response for each point; NULL: there is one */
    const cell_function *sort;
    cell_values strain;       /* (q, m) strains of the iterate */
    cell_values response;     /* (q, m + m m) */
    double *work;             /* (p (m + m m)): the values of one cell */
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

/* Choose the strains of the iterate by equation (5), and evaluate the responses; returns whether
   any strain differs from the linear one. */
int choose_strains(const point_law *law, const strain_choice *choice);

#endif
