/* Film that bears no compression, in the axes of its stiffness.

   Strain e = (E11, E22, 2 E12), stress S = C e of taut film, F the inverse of C.  The relaxed energy

       W(e) = min over A >= 0 of (e + A):C:(e + A)/2 = max over S >= 0 of S:e - S:F:S/2

   is convex and has a continuous stress:

       taut      S = C e                      where C e >= 0 (as a matrix)
       slack     S = 0                        where e <= 0 (as a matrix)
       wrinkled  S = e_tt/F_tt (t x t)        elsewhere, t the direction that maximises e_tt^2/F_tt where e_tt > 0 */
#ifndef GOSSAMER_RELAXED_FILM_H
#define GOSSAMER_RELAXED_FILM_H

#include <stddef.h>

enum film_state { SLACK, WRINKLED, TAUT };

typedef struct {
    double C11, C12, C22, C66;
    double F11, F12, F22, F66;
    double margin; /* stress below which compression is round-off, and the film is taut */
} film_stiffness;

/* The unit vector t of the tension in wrinkled film. */
typedef struct {
    double cosine, sine;
} direction;

/* Stress and its derivative by the strain, or averages of them. */
typedef struct {
    double S[3];
    double D[9];
} film_response;

/* An average along a path of strain. */
typedef struct {
    film_response response;
    double missing; /* energy that the average stress misses */
    double energy;  /* energies of which `missing` is the difference; zero if the average is exact */
} averaged_film;

film_stiffness film_stiffness_of(double C11, double C12, double C22, double C66);

enum film_state film_state_at(const film_stiffness *C, const double *e);

/* The stress C e of taut film. */
void taut_stress(const film_stiffness *C, const double *e, double *S);

/* Add `weight` C to a matrix (3, 3). */
void add_stiffness(const film_stiffness *C, double weight, double *D);

/* The direction of the tension of wrinkled film; near is a guess, or NULL. */
direction tension_direction(const film_stiffness *C, const double *e, const direction *near);

/* Add the stress of wrinkled film, times `weight`, and its derivative, times `derivative_weight`. */
void add_wrinkled(const film_stiffness *C, const double *e, direction t, double weight, double derivative_weight,
                  film_response *sum);

/* W of wrinkled film at e, of which t is known. */
double wrinkled_density(const film_stiffness *C, const double *e, direction t);

/* W at e. */
double relaxed_density(const film_stiffness *C, const double *e);

/* Stress and derivative at e. */
void relaxed_response(const film_stiffness *C, const double *e, film_response *response);

/* Stress averaged along the path from e0 to e1, and its derivative by e1. */
void averaged_response(const film_stiffness *C, const double *e0, const double *e1, averaged_film *average);

#endif
